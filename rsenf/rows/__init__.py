"""Rows: steady-pixel mask and row means, from frames to row blocks."""
