"""Every estimator on a camera that shares nothing with rsenf's own model.

::

    plan     which cases there are, and one method's record of one of them
    table    records to rates
    picture  errors over stated standard errors, over all cells
"""
