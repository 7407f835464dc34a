"""References that go on: a grid's frequency as it is measured, block after block."""

from __future__ import annotations

from rsenf.reference.live.growing import Growing
from rsenf.reference.live.of_camera import CameraReference

__all__ = ["CameraReference", "Growing"]
