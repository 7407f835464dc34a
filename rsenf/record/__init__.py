"""Recordings: everything that travelled, in one MCAP file, and back out of it.

The parts, from the bytes up: ``container`` (records), ``chunk``, ``index`` (the end of a file),
``sound`` (what of it is undamaged), ``scan`` and ``summary`` (what is in a file), ``output`` (the
file being written), ``held`` (that it is), ``finish`` (an end for a file that broke off),
``growing`` (all these, in the making); then ``timeline``, ``tally``, ``continuity``, ``foxglove``,
``channels`` and ``topics`` (how messages become records), ``writer``, ``disk``, ``decoder`` and
``reader``. ``gaps`` and ``examine`` tell what is wrong with a file, ``recover`` saves what isn't.
``archive`` has many files, by site, camera and day; ``export`` makes tables and sounds of one.
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
