"""References: a grid's measured frequency, from a file, the store or a live source.

In: CSV, Parquet, NPZ or WAV files; a sound card, a camera or another node. Out: a
:class:`Reference`, or ``ReferenceBlock`` messages: one uniform UTC axis, gaps as NaN, nothing
interpolated, duplicates and assumptions noted.

Read ``reference`` (the result) and ``open`` first; then ``readings`` (pieces of a file) and
``axis`` (time stamps to samples). Formats: ``table``, ``columns``, ``days``, ``wav``. Times:
``times``, ``local_time``. ``plausible`` checks values and units; ``store`` holds years of several
grids; ``live`` has sources that grow. An argument ``where`` is the file's name, for error messages.
"""

from __future__ import annotations

from rsenf.reference.open import open_reference, read_reference, reference_of
from rsenf.reference.reference import Reference, reference_blocks

__all__ = ["Reference", "open_reference", "read_reference", "reference_blocks", "reference_of"]
