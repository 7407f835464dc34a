"""References: a grid's measured frequency, from a file, the store or a live source.

In: CSV, Parquet, NPZ or WAV files; a sound card, a camera or another node. Out: a
:class:`Reference`, or ``ReferenceBlock`` messages: one uniform UTC axis, gaps as NaN, nothing
interpolated, duplicates and assumptions noted.

Read ``reference`` (the result) and ``read`` first; then ``readings`` (pieces of a file), ``axis``
(time stamps to samples) and ``samples`` (duplicates). Formats: ``table``, ``parquet``, ``columns``,
``days``, ``wav``, ``riff``. Times: ``times``, ``written_times``, ``local_time``, ``daylight``.
``plausible`` checks values and units; ``store`` holds years of several grids; ``live`` has sources
that grow; ``open`` opens any of them by name.
"""

from __future__ import annotations

from rsenf.reference.open import open_reference
from rsenf.reference.read import read_reference, reference_of
from rsenf.reference.reference import Reference, reference_blocks

__all__ = ["Reference", "open_reference", "read_reference", "reference_blocks", "reference_of"]
