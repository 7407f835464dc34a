"""Live references: a grid's frequency as it is measured, block after block.

In: a growing table or WAV file, a sound card, the messages of a camera or of another reference.
Out: ``ReferenceBlock`` messages that continue each other; a new epoch where time jumps.

Read ``growing`` (the axis) and ``on_the_clock`` (a stream's clock to UTC) first; then the sources
``of_file``, ``of_sound``, ``of_camera`` and ``of_topic``.
"""

from __future__ import annotations

from rsenf.reference.live.growing import Growing
from rsenf.reference.live.of_camera import CameraReference
from rsenf.reference.live.of_file import follow_table
from rsenf.reference.live.of_sound import SoundReference, follow_wav
from rsenf.reference.live.of_topic import RelayedReference

__all__ = [
    "CameraReference",
    "Growing",
    "RelayedReference",
    "SoundReference",
    "follow_table",
    "follow_wav",
]
