"""Every estimator on a camera that shares no code with rsenf's own model.

::

    plan     which cases, and one method's record of one of them
    table    records to rates, and the picture of errors over standard errors by cell
"""
