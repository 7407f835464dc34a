"""A rolling-shutter camera from the physics, which shares nothing with rsenf's own model.

`film` turns a `Case` into row levels, stamps and the truth; `as_video` makes a file of it.
`EFFECTS` and `UNKNOWN` are what a case can hide, for who looks for effects, and `HARD` what is hard
on estimators; `FILTERS` are FFmpeg's own, which its file can go through; `trial` draws a case for
these, of a kind in `KINDS`. `simple` is an older, plainer camera.
"""

from .cases import Case, Filmed, draw_case, film, shoot
from .effects import EFFECTS, HARD, NEUTRAL, PHYSICAL, UNKNOWN, Effect, go_together
from .filters import FILTERS, Filter
from .trials import GRIDS, KINDS, RATES, Kind, trial
from .video import CODINGS, as_video, video_case

__all__ = [
    "CODINGS",
    "EFFECTS",
    "FILTERS",
    "GRIDS",
    "HARD",
    "KINDS",
    "NEUTRAL",
    "PHYSICAL",
    "RATES",
    "UNKNOWN",
    "Case",
    "Effect",
    "Filmed",
    "Filter",
    "Kind",
    "as_video",
    "draw_case",
    "film",
    "go_together",
    "shoot",
    "trial",
    "video_case",
]
