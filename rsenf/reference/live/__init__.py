"""Live references: a grid's frequency as it is measured, block after block.

In: a growing table or WAV file, a sound card, the messages of a camera or of another reference.
Out: ``ReferenceBlock`` messages that continue each other; a new epoch where time jumps.

Read ``growing`` (the axis, a stream's clock to UTC, a growing table) first; then ``sources``.
"""

from __future__ import annotations

from rsenf.reference.live.growing import Growing, follow_table
from rsenf.reference.live.sources import (
    CameraReference,
    RelayedReference,
    SoundReference,
    follow_wav,
)

__all__ = [
    "CameraReference",
    "Growing",
    "RelayedReference",
    "SoundReference",
    "follow_table",
    "follow_wav",
]
