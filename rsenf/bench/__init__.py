"""Benchmarks: every method on the same clips, each clip with its truth."""
