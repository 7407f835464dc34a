"""References that go on: a grid's frequency as it is measured, block after block."""

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
