"""References: a grid's measured frequency from a file, on one uniform axis with its gaps.

Years of it, and several grids, are in :mod:`rsenf.reference.store`.
"""

from __future__ import annotations

from rsenf.reference.open import open_reference
from rsenf.reference.read import read_reference, reference_of
from rsenf.reference.reference import Reference, reference_blocks

__all__ = ["Reference", "open_reference", "read_reference", "reference_blocks", "reference_of"]
