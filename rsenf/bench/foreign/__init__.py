"""Every estimator on a camera that shares no code with rsenf's own model.

Here: which cases there are. ``table`` has the record of one method on one case, and the rates.

The camera is a Python package or file, loaded by its path, which doesn't import rsenf. It has

``KINDS``
    Kinds of cases by name, each with ``mains`` (whether there is an ENF), ``filmable`` (whether it
    can be a file) and ``filtered`` (the filter before the encoder, if any).
``RATES``, ``GRIDS``, ``CODINGS``
    Names of frame rates, of kinds of grid and of codings, the first of which is lossless.
``trial(kind, seed, rate=, nominal_hz=, grid=, duration_s=)``
    Draws a case.
``film(case)``
    Simulates it: ``level`` (frames, rows, strips), ``stamp_s`` (frames,), ``truth``, a dict with
    ``idle_ratios`` (the true one, then others that are right as well) and ``direction``, and
    ``mean_hz(begin_s, end_s)``, the grid's mean frequency over intervals of the file's clock.
``video_case(case)``, ``as_video(case, path, columns=, coding=)``
    The case with what a file can hold, and its file.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import zlib
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from types import ModuleType

from rsenf.bench.harness import known_names
from rsenf.errors import UsageError
from rsenf.model.noise import generator

NEEDED = ("KINDS", "RATES", "GRIDS", "CODINGS", "trial", "film", "video_case", "as_video")
RAW = "raw"


@functools.cache
def camera_at(path: Path, needed: tuple[str, ...]) -> ModuleType:
    """Load a camera from its folder or file.

    Parameters
    ----------
    needed : tuple of str
        Names that it must have.
    """
    file = path / "__init__.py" if path.is_dir() else path
    name = f"rsenf_foreign_camera_{zlib.crc32(bytes(file.resolve())):08x}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None or not file.is_file():
        hint = "run it from a checkout, or name another camera"
        raise UsageError(f"no foreign camera at {path}", hint)
    camera = importlib.util.module_from_spec(spec)
    sys.modules[name] = camera  # for imports among its own files
    try:
        spec.loader.exec_module(camera)
    except (Exception, SystemExit) as exc:  # any error of foreign code
        raise UsageError(f"{path}: can't be run: {type(exc).__name__}: {exc}") from exc
    if lacks := [need for need in needed if not hasattr(camera, need)]:
        raise UsageError(f"{path} is no camera: it has no {', '.join(lacks)}")
    return camera


@dataclass(frozen=True)
class ForeignCase:
    """A case of a foreign camera."""

    kind: str  # of light, scene or file
    mains: bool  # whether there is an ENF
    frame_rate: str
    nominal_hz: float
    grid: str
    coding: str  # RAW, or one of the camera's
    seed: int
    duration_s: float

    @property
    def key(self) -> str:
        """Unique name, by which its records are found."""
        cell = f"{self.kind} {self.frame_rate}fps {self.nominal_hz:g}Hz {self.grid} {self.coding}"
        return f"{cell} {self.seed} {self.duration_s:g}s"


@dataclass(frozen=True, kw_only=True)
class EstimatorPlan:
    """How many cases, from which seed on.

    Parameters
    ----------
    raw : int
        Of rows with a mains light, as the camera has them; kinds, rates and grids take turns.
    coded : int
        Of such films, coded and decoded.
    nothing : int
        Without any mains light, rows as well.
    filtered : int
        Of films that go through a filter before they are coded, without loss and as a camera does.
    first_seed : int
        Seed of the first case.
    duration_s : float
        Of each recording.
    kinds : tuple of str
        Those to film; all that the camera has.
    """

    raw: int = 300
    coded: int = 30
    nothing: int = 300
    filtered: int = 0
    first_seed: int = 0
    duration_s: float = 60.0
    kinds: tuple[str, ...] = ()

    def cases(self, camera: ModuleType) -> list[ForeignCase]:
        """Return all cases; those of a larger plan begin with those of a smaller one."""
        known_names(self.kinds, camera.KINDS, "kind")
        kinds = {name: camera.KINDS[name] for name in self.kinds or camera.KINDS}
        whole = [name for name, kind in kinds.items() if not kind.filtered]
        lit = [name for name in whole if kinds[name].mains]
        files = [name for name in lit if kinds[name].filmable]
        dark = [name for name in whole if name not in lit]
        filtered = [name for name in kinds if name not in whole]
        lossless, *codings = camera.CODINGS
        groups = (
            (lit, self.raw, [RAW]), (dark, self.nothing, [RAW]), (files, self.coded, codings),
            (filtered, self.filtered, [lossless, codings[0]]),
        )  # fmt: skip
        cells, cases = list(product(camera.RATES, (50.0, 60.0), camera.GRIDS)), []
        for names, count, among in groups:
            for n in range(count if names else 0):
                kind, coding = names[n % len(names)], among[n % len(among)]
                # Each rate and grid of a kind occurs once before any is repeated.
                order = generator(self.first_seed, f"{kind} {coding}").permutation(len(cells))
                rate, nominal_hz, grid = cells[order[n // len(names) % len(cells)]]
                cases.append(ForeignCase(
                    kind, kinds[kind].mains, rate, nominal_hz, grid, coding,
                    self.first_seed + n, self.duration_s,
                ))  # fmt: skip
        return cases
