"""Finds which effects the capture model lacks of a recording: fit, compare, select, report.

In: row blocks of a recording or stream and a capture model to begin with; optionally a reference of
the grid's frequency. Out: a :class:`rsenf.discrepancy.verdict.Discovery`: verdict, effects, the
extended model, and where model and data still disagree. Read the files in this order::

    data               measured, lines
    model              forward_model, fit_parameters
    fit, noise floor   start, fit, jacobian, series
    residual           gap, residual_breakdown, residual_features
    forward selection  candidates, trial, forward_selection
    no catalogue has   grammar, grammar_search
    report             verdict, residual_classifier, result
    stream             settings, window, watch

``clock_offset`` compares a clip's ENF with the reference, which reveals the camera's clock error.
"""
