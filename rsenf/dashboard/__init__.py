"""A web page with the current state of all feeds on a bus. Read-only.

In: every message on the bus. Out: JSON over a WebSocket, pictures and files over HTTP.

Read ``site`` (the state, fed by every message) first; then its parts: ``wiring`` (what the graph
file tells), ``feed`` (one camera) with ``enf_series``, ``row_strip``, ``spectrogram`` and
``preview``, ``tail`` (incremental images), ``references`` and ``alarm_board``; then ``session``
(incremental updates to one browser), ``app``, ``guard`` (access control), ``recordings`` and
``server``. Memory is bounded: an hour or a year of messages need the same.
"""
