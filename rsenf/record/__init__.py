"""Recordings: everything that travelled, in one MCAP file, and back out of it.

The parts, from the bytes up: ``container`` (records), ``chunk``, ``index`` (the end of a file),
``scan`` and ``summary`` (what is in a file), ``output`` (the file being written), ``finish`` (an
end for a file that broke off), ``growing`` (all these, in the making); then ``timeline``,
``tally``, ``foxglove``, ``channels`` and ``topics`` (how messages become records), ``writer``,
``decoder`` and ``reader``.
"""

from rsenf.record.finish import Finished, close_truncated
from rsenf.record.header import header_of
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
    "header_of",
    "input_facts",
    "open_recording",
]
