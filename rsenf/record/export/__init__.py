"""Exports a topic of a recording to a common file format: a table (CSV, Parquet) or sound (WAV).

``table`` selects a run and epoch, reads row blocks with their idle ratio, and writes messages, or
the frames of row blocks; ``sound`` resamples the rows to a uniform signal.
"""

from rsenf.record.export.sound import SoundFile, write_sound
from rsenf.record.export.table import RecordedLight, Selection, write_table

__all__ = ["Selection", "RecordedLight", "SoundFile", "write_sound", "write_table"]
