"""The kinds of nodes, one class per file: settings, inputs and outputs, and the process's body.

Each class derives from :class:`rsenf.config.node_kind.NodeKind`; most from ``StageNode``, which
runs stages for each camera. In the order of the data: ``decode``, ``rows``, ``track``, ``idle``,
``reference``, ``match``, ``live``, ``discover``; then ``record``, ``replay``, ``dashboard``,
``foxglove``, ``notify`` and ``external``, a program of the user's.

``python -m rsenf_nodes --graph GRAPH.yaml --node NAME`` runs one node of a graph.
"""
