"""Blind discovery on a camera that shares no code with rsenf's own model.

Such a camera is a Python package or file, loaded by its path. It has a simulation of its own,
doesn't import rsenf, and has

``Case(hidden=, seed=, times=, duration_s=, rows=)``
    A case. Grid, frame rate, lamp, scene and noise are drawn from its seed.
``film(case)``
    Simulates it: ``level`` (frames, rows, strips), ``stamp_s`` (frames,), ``truth``, a dict with
    ``frame_rate``, ``nominal_hz``, ``idle_ratio``, ``lamp`` (its kind, ``"tone"`` for a pure one)
    and ``flicker_ratio``, and ``hidden``, the parameters of each effect by name, as they
    show in the rows. :data:`rsenf.bench.discover.judge.SIZES` has those that are compared.
``EFFECTS``, ``UNKNOWN``
    Effects that can be hidden, by name: of rsenf's catalogue, and others. Each has ``needs``
    (``"reference"`` if it doesn't show in rows alone, ``"stamps"`` if it doesn't show in films of a
    constant frame rate) and ``like`` (names of nearly equal effects, which are also right).
``PHYSICAL`` (it may have none)
    What physical programs do that are in no catalogue, by name; their truth has what
    :func:`rsenf.bench.discover.judge.judged_description` compares.
``NEUTRAL``
    Names in ``EFFECTS`` that the fit of the plain model absorbs, without a discrepancy.
``go_together(one, other)``
    Whether both can be hidden at once.
``video_case(case)``, ``as_video(case, path)``
    For ``--video``: the case with what a file can hold, and its file.

The workflow is given levels and time stamps, and starts from a lamp without harmonics. So it may
name ``harmonics`` in any case whose lamp has them. It searches the catalogue and the grammar of
effects, as ``rsenf discover`` does.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from rsenf.bench.discover import Case as SimulatedCase
from rsenf.bench.discover import Plan as SimulatedPlan
from rsenf.bench.discover import groups_of, mixed
from rsenf.bench.discover import left_out as never_hidden
from rsenf.bench.discover.judge import (
    answered,
    closed,
    judged_description,
    judged_foreign,
    parameter_errors,
    recorded,
)
from rsenf.errors import UsageError
from rsenf.model.noise import generator

NEEDED = ("Case", "film", "EFFECTS", "UNKNOWN", "NEUTRAL", "go_together")
KINDS = ("one", "none", "pair", "triple", "unknown", "physical")
OF_LAMPS = "harmonics"
OTHER = 1_000_003  # seed of what a found model films


@functools.cache
def camera_at(path: Path, needed: tuple[str, ...] = NEEDED) -> ModuleType:
    """Load a camera.

    Parameters
    ----------
    path : Path
        Its folder or file.
    needed : tuple of str
        Names it must have.

    Raises
    ------
    UsageError
        When there is none, or it lacks a name.
    """
    file = path / "__init__.py" if path.is_dir() else path
    name = f"rsenf_foreign_camera_{zlib.crc32(bytes(file.resolve())):08x}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None or not file.is_file():
        raise UsageError(
            f"no foreign camera at {path}", "run it from a checkout, or name another camera"
        )
    camera = importlib.util.module_from_spec(spec)
    sys.modules[name] = camera  # for imports among its own files
    try:
        spec.loader.exec_module(camera)
    except (Exception, SystemExit) as exc:  # any error of foreign code
        raise UsageError(f"{path}: can't be run: {type(exc).__name__}: {exc}") from exc
    if lacks := [need for need in needed if not hasattr(camera, need)]:
        raise UsageError(f"{path} is no camera: it has no {', '.join(lacks)}")
    return camera


def left_out(camera: ModuleType) -> dict[str, str]:
    """Return the effects that are never hidden, each with the reason."""
    beside = [name for name, effect in camera.EFFECTS.items() if effect.needs == "reference"]
    never = {name: why for name, why in never_hidden().items() if name in camera.EFFECTS}
    return {
        **never,
        **dict.fromkeys(camera.NEUTRAL, "a model of the rows takes it in: nothing lacks then"),
        **dict.fromkeys(beside, "only a reference of the grid shows it"),
    }


def listed(camera: ModuleType) -> tuple[str, ...]:
    """Return the effects that are hidden."""
    return tuple(name for name in camera.EFFECTS if name not in left_out(camera))


@dataclass(frozen=True, kw_only=True)
class Case(SimulatedCase):
    """A case of a foreign camera.

    Attributes
    ----------
    rows : int
        Of its frames. The others are those of :class:`rsenf.bench.discover.Case`.
    """

    rows: int

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        film = " film" if self.video else ""
        size = f"×{self.times:g} {self.duration_s:g}s {self.rows} rows{film}"
        return f"foreign {self.kind} {'+'.join(self.hidden) or 'nothing'} {size} seed {self.seed}"


@dataclass(frozen=True, kw_only=True)
class Plan(SimulatedPlan):
    """How many cases of each kind; beside those of :class:`rsenf.bench.discover.Plan`.

    Parameters
    ----------
    triples : int
        Of a foreign camera with three effects.
    rows : int
        Of a foreign camera's pictures.
    """

    outside: int = 60
    pairs: int = 60
    effects: tuple[str, ...] = ()
    triples: int = 20
    rows: int = 720

    def cases_of(self, camera: ModuleType) -> list[Case]:
        """Return all cases in random order, each with a seed of its own."""
        effects = self.effects or listed(camera)
        if self.video:
            effects = tuple(name for name in effects if _of(camera, name).needs != "stamps")
        hidden: list[tuple[str, tuple[str, ...]]] = [
            (_kind(camera, name), (name,)) for name in effects for _ in range(self.each)
        ]
        together = [name for name in effects if name not in physical(camera)]
        nothing = ((), (), (), *((name,) for name in camera.NEUTRAL))
        hidden += [("none", nothing[n % len(nothing)]) for n in range(self.none)]
        unknown = list(camera.UNKNOWN)
        hidden += [("unknown", (unknown[n % len(unknown)],)) for n in range(self.outside)]
        for kind, size, count in (("pair", 2, self.pairs), ("triple", 3, self.triples)):
            rng = generator(self.first_seed, kind)
            groups = groups_of(together, size, count, rng, camera.go_together)
            hidden += [(kind, names) for names in groups]
        return mixed(
            [
                Case(
                    kind=kind, hidden=names, seed=self.first_seed + n, times=self.times,
                    duration_s=self.duration_s, rows=self.rows, video=self.video,
                )
                for n, (kind, names) in enumerate(hidden)
            ],
            self.first_seed,
        )  # fmt: skip


def physical(camera: ModuleType) -> dict[str, Any]:
    """Return a camera's physical programs by name."""
    return dict(getattr(camera, "PHYSICAL", {}))


def _kind(camera: ModuleType, name: str) -> str:
    if name in physical(camera):
        return "physical"
    return "unknown" if name in camera.UNKNOWN else "one"


def tried(case: Case, path: Path) -> dict[str, Any]:
    """Simulate a case, run the workflow on it, and judge the result.

    Parameters
    ----------
    case : Case
    path : Path
        Of the camera.
    """
    # Imported here, since the command's help imports this module.
    from rsenf.discrepancy.result import discovery_json, model_of
    from rsenf.discrepancy.start import PLAIN
    from rsenf.discrepancy.verdict import discover

    camera = camera_at(path)
    asked = camera.Case(
        hidden=case.hidden, seed=case.seed, times=case.times,
        duration_s=case.duration_s, rows=case.rows,
    )  # fmt: skip
    filmed = camera.film(camera.video_case(asked) if case.video else asked)
    truth = filmed.truth

    described = case.kind == "physical"

    def work() -> tuple[dict[str, Any], Any]:
        data = _measured(camera, asked, filmed, video=case.video)
        found = discover(PLAIN, data, beyond_catalogue=True)
        return discovery_json(found, ""), found

    answer, found, refused, cpu_s = answered(work)
    idle = model_of(found, "a case").shutter.idle_ratio if found else None
    like = {name: tuple(_of(camera, name).like) for name in case.hidden}
    of_lamp = () if truth["lamp"] == "tone" else (OF_LAMPS,)
    errors = parameter_errors(filmed.hidden, answer, case.duration_s)
    shares = closed(answer, like, of_lamp)
    # Each of two fields has half the frame period.
    true_idle = truth["idle_ratio"] * 2 - 1 if "interlace" in case.hidden else truth["idle_ratio"]
    return {
        **recorded(case, answer, refused, cpu_s),
        **(
            judged_description(filmed.hidden[case.hidden[0]], answer, of_lamp)
            if described
            else judged_foreign(case.kind, like, answer, of_lamp)
        ),
        "words": [e["words"] for e in answer["effects"] if "words" in e],
        "given_back": _given_back(found) if described and answer["verdict"] == "explained" else "",
        "truth": filmed.hidden,
        "told": [e["parameters"] for e in answer["effects"]],
        "relative_error": {name: error[0] for name, error in errors.items()},
        "error_over_stderr": {name: error[1] for name, error in errors.items()},
        "closed": shares[0],
        "closed_beside": shares[1],
        "frame_rate": truth["frame_rate"],
        "nominal_hz": truth["nominal_hz"],
        "lines": case.rows,
        "strips": filmed.level.shape[2],
        "lamp": truth["lamp"],
        "flicker_ratio": truth["flicker_ratio"],
        "idle_ratio": true_idle,
        "idle_error": None if idle is None else idle - true_idle,
    }


def _given_back(found: Any) -> str:
    """Simulate with the model that was found, on its own light; return the verdict on that."""
    from rsenf.discrepancy.measured import measured_of
    from rsenf.discrepancy.result import model_of
    from rsenf.discrepancy.verdict import discover
    from rsenf.messages import Header
    from rsenf.model import simulate_rows
    from rsenf.rows.stage import blocks_from_luminance

    model, data = model_of(found, "a case"), found.last.data
    grid, duration_s = found.last.forward.course.grid(), float(data.time_s[-1])
    rows = simulate_rows(model, grid, duration_s, OTHER, strips=data.strips)
    blocks = blocks_from_luminance(rows.level, rows.frame_time_s, Header())
    return discover(model, measured_of(list(blocks))).verdict


def _of(camera: ModuleType, name: str) -> Any:
    return {**camera.EFFECTS, **camera.UNKNOWN, **physical(camera)}[name]


def _measured(camera: ModuleType, asked: Any, filmed: Any, *, video: bool) -> Any:
    """Return the data for the workflow: raw rows, or those of an encoded film."""
    from rsenf.bench.discover.trial import sampled
    from rsenf.discrepancy.measured import measured_of
    from rsenf.messages import Header
    from rsenf.rows.stage import blocks_from_luminance

    if not video:
        return measured_of(list(blocks_from_luminance(filmed.level, filmed.stamp_s, Header())))
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mkv"
        camera.as_video(asked, film)
        return sampled(film)[0]
