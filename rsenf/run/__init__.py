"""Runs stages: as node processes of a supervised graph, or all together in one process.

In: a graph file (:class:`rsenf.config.Graph`) or a recording (:class:`rsenf.run.inputs.Input`).
Out: messages on the bus, recordings, or an :class:`rsenf.run.inline.Analysis`.

Read first ``stages`` (what each stage reads and sends) and ``runner`` (the life cycle of a stage).
One process: ``inputs``, then ``inline``. A graph: ``node`` (a node process), ``pump`` (its loop),
``peers``, ``health`` and ``heartbeat`` (what others know of a node); then ``supervisor``,
``fork_server``, ``graph_run`` and ``restart_policy`` (start, watch, restart). The rest serves
these: ``process`` (its end, Ctrl-C), ``access`` (TLS), ``recording``, ``metrics``, ``view``,
``notify`` (alarms to people); ``replay`` plays recordings, ``foreign`` reads MCAP files of other
programs.
"""
