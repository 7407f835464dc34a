"""The Python API: what rsenf does with recordings, as functions that the command line calls too.

In: a recording (file, arrays or an opened input), and for some a reference of the grid. Out: a
result object, whose ``to_dict()`` is the JSON of the command line. Read ``shared`` (inputs,
references, settings, base class of results) first, then one file per function: ``track``, ``idle``,
``verify``, ``against``, ``live``, ``discover``, ``simulate``, ``camera``, ``recordings`` (with the
checkpoints of ``discover``). ``unknown_rate`` and ``verify_report`` belong to ``verify``; ``demo``
makes the demo. The functions are ``rsenf.track`` and so on, imported on first access.
"""
