"""Recordings: messages to MCAP files and back, with examination and recovery of damaged files.

In: messages by key. Out: an MCAP file (https://mcap.dev/spec), and its messages in order.

Read ``writer`` and ``reader`` first. Files, from the bytes up: ``container`` (records), ``chunk``,
``index`` (summary section), ``intact_records`` (skips damage), ``scan`` and ``summary`` (contents),
``output`` (the file being written), ``write_lock``, ``finish`` (closes a truncated file) and
``growing`` (a file with all of these). Messages to records: ``topics``, ``channels``, ``foxglove``,
``timeline``, ``tally``, ``continuity``, ``decoder``. ``disk`` watches the free space. ``gaps`` and
``examine`` diagnose a file, ``recover`` copies what is intact. ``archive`` holds many files by
site, camera and day; ``export`` writes tables and sound.
"""

from rsenf.record.finish import Finished, close_truncated
from rsenf.record.provenance import input_facts
from rsenf.record.reader import Loss, Recording, open_recording
from rsenf.record.topics import Topic
from rsenf.record.writer import Recorder

__all__ = [
    "Finished",
    "Loss",
    "Recorder",
    "Recording",
    "Topic",
    "close_truncated",
    "input_facts",
    "open_recording",
]
