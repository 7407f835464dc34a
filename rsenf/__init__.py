"""rsenf reads the electric network frequency (ENF) out of rolling-shutter video.

The rooms of the package, in the order data flows through them::

    decode -> rows -> track -> match        the signal rooms: pure, no bus, files or clocks
    messages                                what travels between them, and is recorded
    bus, config, record                     how it travels, what is wanted, what is kept
    run, report, api, cli                   what a person starts

What is done with recordings is here, as functions; nothing of them is imported before it is asked
for::

    >>> import rsenf
    >>> found = rsenf.verify("clip.mp4", "reference.csv")    # doctest: +SKIP
    >>> print(found)                                         # doctest: +SKIP
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.api.discover import discover
    from rsenf.api.idle import compare_idle, idle
    from rsenf.api.live import live
    from rsenf.api.recordings import read_recording
    from rsenf.api.simulate import simulate
    from rsenf.api.track import track
    from rsenf.api.verify import verify, verify_against

__all__ = [
    "compare_idle",
    "discover",
    "idle",
    "live",
    "read_recording",
    "simulate",
    "track",
    "verify",
    "verify_against",
]
__version__ = "0.1.0"

_HOME = {"compare_idle": "idle", "read_recording": "recordings", "verify_against": "verify"}


class _Package(ModuleType):
    """Keeps ``rsenf.track``, ``rsenf.idle`` and ``rsenf.live`` functions.

    Rooms have these names too, and importing one would put it in the function's place. What is in
    a room is imported from it: ``from rsenf.track import METHODS``.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    function = getattr(importlib.import_module(f"rsenf.api.{_HOME.get(name, name)}"), name)
    globals()[name] = function
    return function


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
