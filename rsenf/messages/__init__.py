"""The messages between stages, which are also recorded: one file per message, one wire format.

Conventions: a quantity's unit is in its name; NaN means "unknown" for a float, 0 for a wall-clock
time; every message starts with a :class:`Header`. ``configs/schema/rsenf.proto`` is generated
from these classes (``rsenf explain schemas``), and a test fails when it is stale.

Read ``header`` first, then the messages in the order of the pipeline: ``frame``, ``row_block``,
``enf_estimate``, ``idle_estimate`` (with ``rate_hypothesis``), ``reference_block``,
``match_result``, ``verdicts``, ``health``. ``schema`` derives Protobuf from the classes, ``codec``
serialises, ``plausible`` checks received messages, ``plain`` and ``proto_text`` show them.
"""

from rsenf.messages.codec import (
    canonical,
    class_for,
    decode,
    descriptor_set,
    digest,
    encode,
    encoding_of,
    schema_name,
)
from rsenf.messages.enf_estimate import EnfEstimate
from rsenf.messages.frame import Frame, VideoPacket
from rsenf.messages.header import Header, Mark, RateBasis
from rsenf.messages.health import Health
from rsenf.messages.idle_estimate import IdleEstimate
from rsenf.messages.match_result import Candidate, Edit, MatchResult, Segment
from rsenf.messages.rate_hypothesis import RateHypothesis
from rsenf.messages.reference_block import ReferenceBlock
from rsenf.messages.row_block import RowBlock
from rsenf.messages.verdicts import Alarm, DiscoveryVerdict, FoundEffect, Liveness

__all__ = [
    "Alarm",
    "Candidate",
    "DiscoveryVerdict",
    "Edit",
    "EnfEstimate",
    "FoundEffect",
    "Frame",
    "Header",
    "Health",
    "IdleEstimate",
    "Liveness",
    "Mark",
    "MatchResult",
    "RateBasis",
    "RateHypothesis",
    "ReferenceBlock",
    "RowBlock",
    "Segment",
    "VideoPacket",
    "canonical",
    "class_for",
    "decode",
    "descriptor_set",
    "digest",
    "encode",
    "encoding_of",
    "schema_name",
]
