"""References: a grid's measured frequency from a file, on one uniform axis with its gaps."""

from __future__ import annotations

from rsenf.reference.read import read_reference
from rsenf.reference.reference import Reference, reference_blocks

__all__ = ["Reference", "read_reference", "reference_blocks"]
