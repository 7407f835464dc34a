"""``python -m rsenf_nodes --graph GRAPH.yaml --node NAME``: run one node of a graph."""

from rsenf.run.node import run_node

run_node()
