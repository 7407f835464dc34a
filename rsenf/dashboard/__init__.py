"""A web page with the current state of all feeds on a bus. Read-only.

In: every message on the bus. Out: JSON over a WebSocket, pictures and files over HTTP.

Read ``site`` (the state, fed by the graph file and every message) first; then its parts: ``feed``
(one camera) with ``enf_series`` (and references), ``spectrogram`` (and rows), and ``alarm_board``
(and recordings); then ``app`` (incremental updates to one browser, access control) and ``server``.
Memory is bounded: an hour or a year of messages need the same.
"""
