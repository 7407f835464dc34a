"""Where a model of a capture and the data disagree, what is missing, and how much it explains.

One idea a file, in the order of the work::

    measured     row means in blocks of time: some to fit to, the others to score on
    lines        as many of them as a fit needs
    apart        along which axis of them neighbours' noise is their own
    estimates    what the estimators of rsenf see in them
    theory       a capture model and a course of the light's phase, simulated at will
    knobs        what can be turned on a model
    slopes       what the rows do when one is
    linear       the small linear problem of one step
    series       effects that have a value of their own for each frame or line
    lean         where in a strip its light comes from
    fit          Gauss-Newton steps, every derivative made by the capture model
    start        where the first fit begins
    stamps       what the frames' stamps tell, before any row is looked at
    gap          the systematic part of what is left, and its error
    where        the gap taken apart: by time, row, level, strip, step and frequency
    residue      what is left, summed up for effects to guess from
    order        of how many members a list of amplitudes is
    candidates   which effects might explain it
    trial        one of them fitted, and judged by held-out data
    search       what held-out data support
    floor        how small a gap can be
    usual        and what a codec makes of it
    signs        what is left, measured in ways that tell causes apart
    tone         a line among it, and of which frequencies it may be an alias
    hint         a guess of its kind
    would_tell   which further measurement would tell, for each kind
    verdict      all of it on one recording
    course       of which form a course over time is
    result       as plain values, and as a model

and on a stream, window by window::

    rolling      the newest rows, averaged down
    window       all of it on one window
    seen         what was found in it
    news         what isn't as in the window before
    watch        the stage

and, in ``beside``, what a reference of the grid's frequency tells beyond the rows.
"""
