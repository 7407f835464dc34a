"""A topic of a recording as a file that any other program reads: a table, or a sound.

``columns`` says which columns a message has, ``frame_rows`` those of the frames of row blocks,
``table`` writes them as CSV or Parquet; ``recorded_light`` reads rows and how they were read out,
``luminance`` makes a signal of them, ``sound`` writes it as WAV.
"""

from rsenf.record.export.part import Part
from rsenf.record.export.recorded_light import RecordedLight
from rsenf.record.export.sound import SoundFile, write_sound
from rsenf.record.export.table import write_table

__all__ = ["Part", "RecordedLight", "SoundFile", "write_sound", "write_table"]
