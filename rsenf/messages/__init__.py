"""The messages between stages, which are also recorded, and their one wire format.

Conventions: a quantity's unit is in its name; NaN means "unknown" for a float, 0 for a wall-clock
time; every message starts with a :class:`Header`. ``configs/schema/rsenf.proto`` is generated
from these classes (``rsenf explain schemas``), and a test fails when it is stale.

Read ``header`` first, then the messages in the order of the pipeline: ``video``, ``estimates``,
``verdicts``. ``schema`` derives Protobuf from the classes, ``codec`` serialises, and ``plausible``
checks received messages.
"""

from rsenf.messages.codec import (
    canonical,
    class_for,
    decode,
    descriptor_set,
    digest,
    encode,
    encoding_of,
    header_of,
    schema_name,
)
from rsenf.messages.estimates import EnfEstimate, IdleEstimate, RateHypothesis, ReferenceBlock
from rsenf.messages.header import Header, Mark, RateBasis
from rsenf.messages.verdicts import (
    Alarm,
    Candidate,
    DiscoveryVerdict,
    Edit,
    FoundEffect,
    Health,
    Liveness,
    MatchResult,
    Segment,
)
from rsenf.messages.video import Frame, RowBlock, VideoPacket

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
    "header_of",
    "schema_name",
]
