"""The kinds of nodes, one file each: its settings, what it reads and sends, what its process does.

``python -m rsenf_nodes --graph GRAPH.yaml --node NAME`` runs one of a graph's.
"""
