"""A web page with the state of all feeds on a bus. It changes nothing but its log of alarms.

In: every message on the bus. Out: JSON over a WebSocket, pictures and files over HTTP.

Read ``site`` (the state, fed by the graph file and every message) first; then its parts: ``feed``
(one camera) with ``enf_series`` (and references), ``spectrogram`` (and rows), and ``alarm_board``;
then ``app`` (incremental updates to one browser) and ``server`` (access control).
Memory is bounded: an hour or a year of messages need the same.
"""
