"""Finds which effects the capture model lacks of a recording: fit, compare, select, report.

In: row blocks of a recording or stream and a capture model to begin with; optionally a reference of
the grid's frequency. Out: a :class:`rsenf.discrepancy.verdict.Discovery`: verdict, effects, the
extended model, and where model and data still disagree. Read the files in this order::

    data               measured, estimates, lines, noise_axis
    model              forward_model, fit_parameters
    fit                start, fit, jacobian, linear, series, strip_centroid
    residual           gap, residual_breakdown, residue
    forward selection  candidates, order, trial, heterogeneity, noise_floor, codec_baseline,
                       forward_selection
    report             verdict, tone, residual_classifier, next_measurement, result
    stream             settings, window_buffer, window, window_summary, watch

``clock_offset`` compares a clip's ENF with the reference, which reveals the camera's clock error.
"""
