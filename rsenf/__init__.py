"""rsenf reads the electric network frequency (ENF) out of rolling-shutter video.

The subpackages, in the order of the data flow; each ``__init__`` says where to begin::

    decode -> rows -> track -> match    pictures, row means, ENF, time of recording
    flicker                             tracker of the light's phase, shared by track, idle and live
    idle, live                          idle period; liveness of a feed
    model, discrepancy                  capture model; 'discover': which effects it lacks
    reference                           frequency of the grid
    messages                            messages between the stages, also recorded
    bus, config, record, regress        transport, graph files, recordings, regression tests
    run, api, cli, report, dashboard    what a person starts and reads
    batch, bench                        many recordings; accuracy and speed

The functions for analysing recordings are attributes of this package, imported on first access::

    >>> import rsenf
    >>> found = rsenf.verify("clip.mp4", "reference.csv")    # doctest: +SKIP
    >>> print(found)                                         # doctest: +SKIP
"""

from __future__ import annotations

import sys
from types import ModuleType

TYPE_CHECKING = False  # instead of typing.TYPE_CHECKING: typing is slow to import
if TYPE_CHECKING:
    from typing import Any

    from rsenf.api.against import verify_against, verify_together
    from rsenf.api.camera import add_camera, identify_camera, list_cameras
    from rsenf.api.discover import discover
    from rsenf.api.idle import compare_idle, idle
    from rsenf.api.live import live
    from rsenf.api.recordings import read_recording
    from rsenf.api.simulate import simulate
    from rsenf.api.track import track
    from rsenf.api.verify import verify

__all__ = [
    "add_camera",
    "compare_idle",
    "discover",
    "identify_camera",
    "idle",
    "list_cameras",
    "live",
    "read_recording",
    "simulate",
    "track",
    "verify",
    "verify_against",
    "verify_together",
]
__version__ = "0.1.0"

_ROOMS = ("track", "idle", "live")
_HOME = {
    **dict.fromkeys(("add_camera", "identify_camera", "list_cameras"), "camera"),
    "compare_idle": "idle",
    "read_recording": "recordings",
    **dict.fromkeys(("verify_against", "verify_together"), "against"),
}


class _Room(ModuleType):
    # A subpackage such as ``rsenf.track`` that is also callable as the function of its name.
    __doc__ = property(lambda room: room.__wrapped__.__doc__)

    @property
    def __wrapped__(self) -> Any:
        return _function(self.__name__.removeprefix("rsenf."))

    def __call__(self, *args: Any, **more: Any) -> Any:
        return self.__wrapped__(*args, **more)


class _Package(ModuleType):
    """Makes ``rsenf.track``, ``rsenf.idle`` and ``rsenf.live`` callable, however imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in __all__ and isinstance(value, ModuleType):
            value.__class__ = _Room
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def _function(name: str) -> Any:
    import functools
    import importlib

    found = getattr(importlib.import_module(f"rsenf.api.{_HOME.get(name, name)}"), name)

    @functools.wraps(found)
    def limited(*args: Any, **more: Any) -> Any:
        import scipy.linalg  # noqa: F401  its own BLAS is limited only once it is loaded
        from threadpoolctl import threadpool_limits

        # On matrices as small as ours, more threads cost processor time and gain nothing.
        with threadpool_limits(1, user_api="blas"):
            return found(*args, **more)

    return limited


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _ROOMS:
        import importlib

        return importlib.import_module(f"rsenf.{name}")
    found = globals()[name] = _function(name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
