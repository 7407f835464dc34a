"""``python -m rsenf_nodes --graph GRAPH.yaml --node NAME``: one node of a graph, of any kind."""

from rsenf.run.node import run_node

run_node()
