"""Live references: a grid's frequency as it is measured, block after block.

In: a growing table or WAV file, a sound card, the messages of a camera or of another reference.
Out: ``ReferenceBlock`` messages that continue each other; a new epoch where time jumps.

Read ``growing`` (the axis, and a stream's clock to UTC) first; then the sources ``of_file``,
``of_sound`` and ``of_messages``.
"""

from __future__ import annotations

from rsenf.reference.live.growing import Growing
from rsenf.reference.live.of_file import follow_table
from rsenf.reference.live.of_messages import CameraReference, RelayedReference
from rsenf.reference.live.of_sound import SoundReference, follow_wav

__all__ = [
    "CameraReference",
    "Growing",
    "RelayedReference",
    "SoundReference",
    "follow_table",
    "follow_wav",
]
