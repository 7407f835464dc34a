"""Exports a topic of a recording to a common file format: a table (CSV, Parquet) or sound (WAV).

``selection`` selects a run and epoch, and reads row blocks with their idle ratio. ``table`` writes
messages, or the frames of row blocks; ``sound`` resamples the rows to a uniform signal.
"""

from rsenf.record.export.selection import Part, RecordedLight
from rsenf.record.export.sound import SoundFile, write_sound
from rsenf.record.export.table import write_table

__all__ = ["Part", "RecordedLight", "SoundFile", "write_sound", "write_table"]
