"""Exports a topic of a recording to a common file format: a table (CSV, Parquet) or sound (WAV).

``part`` selects a run and epoch. ``table`` writes messages, or the frames of row blocks.
``recorded_light`` reads row blocks with their idle ratio, ``luminance`` resamples them to a uniform
signal, and ``sound`` writes that as WAV.
"""

from rsenf.record.export.part import Part
from rsenf.record.export.recorded_light import RecordedLight
from rsenf.record.export.sound import SoundFile, write_sound
from rsenf.record.export.table import write_table

__all__ = ["Part", "RecordedLight", "SoundFile", "write_sound", "write_table"]
