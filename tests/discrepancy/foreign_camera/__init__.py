"""A rolling-shutter camera from the physics, which shares nothing with rsenf's own model.

`film` turns a `Case` into row levels, stamps and the truth; `as_video` makes a file of it.
`EFFECTS` and `UNKNOWN` are what a case can hide. `simple` is an older, plainer camera.
"""

from .cases import Case, Filmed, draw_case, film, shoot
from .effects import EFFECTS, NEUTRAL, UNKNOWN, Effect, go_together
from .video import as_video, video_case

__all__ = [
    "EFFECTS",
    "NEUTRAL",
    "UNKNOWN",
    "Case",
    "Effect",
    "Filmed",
    "as_video",
    "draw_case",
    "film",
    "go_together",
    "shoot",
    "video_case",
]
