"""One clip, from its seed to its record: rendered, encoded, decoded, and judged by every method.

It is rendered once; row blocks come from the raw frames, and from every encoding after decoding.
All methods see the same blocks, and their errors against the truth are plain values.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import math
import platform
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

import rsenf
from rsenf.bench.harness import timed
from rsenf.bench.scenes import LIT, SceneClip, Setting, codec_of, grid_for, setting_of
from rsenf.bench.statistics import Row
from rsenf.decode import SourceSpec, open_source
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.idle import IdleSettings, make_idle
from rsenf.idle.coherent import idle_ratio_bound
from rsenf.messages import EnfEstimate, Frame, Header, IdleEstimate, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.model import FrameStream, GridPath, write_videos
from rsenf.model.exposures import Capture
from rsenf.model.noise import QUANTISATION_VAR
from rsenf.rows.stage import Rows
from rsenf.stage import Stage
from rsenf.timebase import pts_to_ns
from rsenf.track import METHODS as ENF_METHODS
from rsenf.track import TrackSettings, make_tracker

VERSION = 1
_LIBRARIES = ("av", "numpy", "opencv-python-headless", "scipy")
MEAN_S = 1.0  # an ENF estimate is compared with the mean over so long about its time
Luma = NDArray[np.uint8]


class Filmed(NamedTuple):
    """A clip as row blocks."""

    truth: Row
    blocks: dict[str, list[RowBlock]]  # by coding
    # Processor time of `film` (rendering, encoding) and `decode` (decoding, sampling).
    cpu_s: dict[str, float]


class _Sampled(FrameStream):
    """The frames of a clip, whose rows are sampled before the encoders get them."""

    def __init__(self, capture: Capture) -> None:
        super().__init__(capture)
        self.rows, self.blocks = Rows(), list[RowBlock]()

    def __iter__(self) -> Iterator[tuple[int, Luma]]:
        for number, (pts, luma) in enumerate(super().__iter__()):
            frame = frame_of(number, luma, pts_to_ns(pts, self.time_base))
            self.blocks += self.rows.update(frame)
            yield pts, luma


def film(setting: Setting, grid: GridPath, duration_s: float, codings: Sequence[str]) -> Filmed:
    """Film a clip, encode it in the same pass, decode, and sample the rows of every coding.

    Rows of the lossless coding are sampled from the raw frames.

    Parameters
    ----------
    codings : sequence of str
        As of :func:`rsenf.bench.scenes.codec_of`.
    """
    begin_s = time.process_time()
    frames = _Sampled(Capture(setting.model, grid, duration_s, setting.seed))
    codecs = {coding: codec_of(coding) for coding in codings}
    with tempfile.TemporaryDirectory(prefix="rsenf-bench-") as folder:
        files = {coding: Path(folder) / f"{coding}.mp4" for coding in codings}
        write_videos({files[c]: codec for c, codec in codecs.items() if codec}, frames)
        coded_s, raw = time.process_time(), frames.blocks + frames.rows.flush()
        blocks = {c: decoded(files[c]) if codec else raw for c, codec in codecs.items()}
    cpu_s = {"film": coded_s - begin_s, "decode": time.process_time() - coded_s}
    return Filmed(frames.truth, blocks, cpu_s)


def frame_of(number: int, luma: Luma, pts_ns: int = 0) -> Frame:
    """Return a plane as a frame of some number."""
    header = Header(frame_first=number, frame_last=number, seq=number, pts_ns=pts_ns)
    return Frame(header=header, height_px=luma.shape[0], width_px=luma.shape[1], luma=luma)


def decoded(path: Path) -> list[RowBlock]:
    """Decode a video file and sample its rows with the default settings."""
    # One thread: several clips are measured in parallel.
    spec = SourceSpec(url=str(path), kind="file", threads=1)
    with open_source(spec, source="", run_id="", clock_ns=lambda: 0) as frames:
        return through(Rows(), frames)


def arrived(message: Any, at_ns: int) -> Any:
    """Return a message that arrives at another time of the host."""
    header = dataclasses.replace(message.header, arrival_time_ns=at_ns)
    return dataclasses.replace(message, header=header)


def through(stage: Stage, messages: Iterable[Any]) -> list[Any]:
    """Return all that a stage makes of messages and of their end."""
    return [made for message in messages for made in stage.update(message)] + stage.flush()


class Mains(Protocol):
    """The true frequency of the grid."""

    def mean_hz(self, begin_s: FloatArray, end_s: FloatArray) -> FloatArray:
        """Mean frequency of intervals, in seconds from the first frame."""
        ...


def enf_by(method: str, blocks: Sequence[RowBlock], grid: Mains) -> Row:
    """Run an ENF method; return its usable estimates with their errors.

    Parameters
    ----------
    blocks : sequence of RowBlock
    grid : Mains
        The truth, on the clock of the file.
    """
    stage = make_tracker(TrackSettings(method=method))
    return tried(lambda: through(stage, blocks), partial(_enf, grid))


def idle_by(method: str, blocks: Sequence[RowBlock], true_ratio: float) -> Row:
    """Run one idle method; return its result."""
    stage = make_idle(IdleSettings(method=method, every_s=math.inf))
    return tried(lambda: through(stage, blocks), partial(_idle, true_ratio))


def tried(work: Callable[[], list[Any]], describe: Callable[[list[Any]], Row]) -> Row:
    """Time a method; an exception is recorded as ``broke``, and the others still run.

    Parameters
    ----------
    work, describe : callable
        Returns messages; makes the record of them.
    """
    try:
        out, cpu_s = timed(work)
    except Exception as exc:  # noqa: BLE001  # counted in the table
        return {"broke": f"{type(exc).__name__}: {exc}"}
    return {"cpu_s": round(cpu_s, 4), **describe(out)}


def _idle(true_ratio: float, out: list[Any]) -> Row:
    estimates = [m for m in out if isinstance(m, IdleEstimate)]
    if not estimates:
        return {"verdict": "no_signal", "reason": "nothing was said"}
    last = estimates[-1]
    return {
        "verdict": last.verdict,
        "reason": last.reason,
        "idle_percent": number(100 * last.idle_ratio),
        "error_percent": number(100 * (last.idle_ratio - true_ratio)),
        "std_percent": number(100 * last.idle_ratio_std),
        "interval_percent": [number(100 * last.idle_ratio_low), number(100 * last.idle_ratio_high)],
        "direction": last.direction,
        "nominal_hz": number(last.nominal_hz),
        "warnings": list(last.warnings),
    }


def _enf(grid: Mains, out: list[Any]) -> Row:
    """Return times and errors (mHz) of the usable estimates."""
    estimates = [m for m in out if isinstance(m, EnfEstimate) and m.rank == 0]
    good = [m for m in estimates if m.usable]
    t_s = np.array([m.t_s for m in good])
    found_hz = np.array([m.enf_hz for m in good])
    # Estimates are on a clock without the slips; the grid's truth is on the file's clock.
    slipped_s = np.cumsum(
        [m.slip_frames.sum() / m.frame_rate_hz if m.slips else 0.0 for m in estimates]
    )
    after_s = np.array([late for m, late in zip(estimates, slipped_s, strict=True) if m.usable])
    before_s = np.append(0.0, slipped_s)[:-1][[m.usable for m in estimates]]
    begin_s, end_s = t_s - MEAN_S / 2 - before_s, t_s + MEAN_S / 2 - after_s
    true_hz = grid.mean_hz(begin_s, end_s) if good else found_hz
    error_hz = found_hz - true_hz
    # Where the read-out direction is unknown, the deviation may have either sign.
    mirror_hz = np.array([m.mirror_hz for m in good])
    mirrored_hz = np.where(mirror_hz > 0.0, 2.0 * mirror_hz - found_hz - true_hz, error_hz)
    error_hz = min(error_hz, mirrored_hz, key=lambda error: float(error @ error))
    return {
        "t_s": [round(t, 4) for t in t_s.tolist()],
        "error_mhz": [number(1e3 * e, 6) for e in error_hz.tolist()],
        "std_mhz": [number(1e3 * m.enf_std_hz, 6) for m in good],
        "unusable": dict(Counter(m.reason for m in estimates if not m.usable)),
    }


def number(value: float, digits: int = 8) -> float | None:
    """Return a number for JSON: rounded, or None where it isn't finite."""
    return round(float(value), digits) if math.isfinite(value) else None


def measure(clip: SceneClip, grids: Path | None) -> Row:
    """Film a clip and run every method on it; return the record, as plain values.

    Parameters
    ----------
    grids : Path or None
        Folder of measured grids; synthetic ones without it.
    """
    begin_s, made_by = time.perf_counter(), versions()
    setting = setting_of(clip)
    grid, grid_name = grid_for(grids, clip.nominal_hz, clip.duration_s, clip.generator("grid"))
    filmed = film(setting, grid, clip.duration_s, clip.codings)
    truth = filmed.truth
    return {
        "version": VERSION,
        **dataclasses.asdict(clip),
        "codings": list(clip.codings),
        "frames": truth["frames"],
        "grid": grid_name,
        "grid_start_s": truth["reference_start_s"],
        "simulation_seed": setting.seed,
        "lamp": setting.model.light.lamp,
        "idle_percent": 100 * truth["idle_ratio"],
        "exposure_s": setting.exposure_s,
        "mean_level": setting.model.scene.mean_level,
        **(_lit_facts(clip, setting, grid) if clip.scene == LIT else {}),
        "found": {
            codec: {
                "idle": {m: idle_by(m, blocks, truth["idle_ratio"]) for m in IDLE_METHODS},
                "enf": {m: enf_by(m, blocks, grid) for m in ENF_METHODS},
            }
            for codec, blocks in filmed.blocks.items()
        },
        "cpu_s": {step: round(s, 2) for step, s in filmed.cpu_s.items()},
        "wall_s": round(time.perf_counter() - begin_s, 2),
        "versions": made_by,
    }


def _lit_facts(clip: SceneClip, setting: Setting, grid: GridPath) -> Row:
    """Return flicker, noise and the Cramér–Rao bounds of a clip with a lamp."""
    model, shutter = setting.model, setting.model.shutter
    levels = setting.flicker_levels(clip.nominal_hz)
    pixel_var = model.sensor.variance(np.array([model.scene.level], np.float32)) + QUANTISATION_VAR
    row_noise = float(np.sqrt(pixel_var[0] / shutter.across_px))
    rate_hz = float(shutter.frame_rate)
    known: Row = {"noise_level": row_noise, "amplitude_level": levels}
    known |= {"rows": shutter.rows, "frame_rate_hz": rate_hz}
    f0_hz, frames = 2 * clip.nominal_hz, round(clip.duration_s * shutter.frame_rate)
    # Where the flicker's alias at the frame rate is at 0 Hz, only the grid's deviation moves its
    # phase; below 1 rad over the clip, flicker can't be separated from texture.
    t_s = np.arange(0.0, clip.duration_s, 1 / rate_hz)
    alias_cycles = 2 * grid.cycles(t_s) - round(f0_hz / rate_hz) * rate_hz * t_s
    return {
        "flicker_level": levels[0],
        "row_noise_level": row_noise,
        "alias_turn_rad": float(np.ptp(2 * np.pi * alias_cycles)),
        "enf_bound_mhz": 1e3 * enf_bound_hz(**known, read_out_time_s=shutter.read_out_time_s),
        "idle_bound_percent": 100 * idle_ratio_bound(**known, frames=frames, f0_hz=f0_hz),
    }


def enf_bound_hz(
    *,
    noise_level: float,
    amplitude_level: Sequence[float],
    rows: int,
    frame_rate_hz: float,
    read_out_time_s: float,
    seconds: float = 1.0,
) -> float:
    """Return the Cramér–Rao bound of the mean ENF over an interval of row means.

    Of the frequency of a tone in white noise with unknown phase, and known amplitudes and texture
    (Rife and Boorstyn 1974, here for samples at any times). Harmonic ``k`` has ``k`` times the
    phase, so a sample has Fisher information ``Σ (k·A_k)² / 2σ²`` on it. An estimator that also
    uses the time before and after can have a smaller error, since the ENF varies slowly.

    Parameters
    ----------
    noise_level : float
        Standard deviation of the noise of one row's mean, levels.
    amplitude_level : sequence of float
        Amplitudes of the harmonics 1, 2, … of the flicker, levels.

    Returns
    -------
    float
        Standard deviation, Hz of the ENF; infinite without flicker.
    """
    frame_s = np.arange(max(round(seconds * frame_rate_hz), 1)) / frame_rate_hz
    t_s = frame_s[:, None] + np.arange(rows) * (read_out_time_s / rows)
    order = np.arange(1, len(amplitude_level) + 1)
    of_phase = float(np.sum((order * np.asarray(amplitude_level)) ** 2)) / (2 * noise_level**2)
    of_slope = of_phase * float(np.sum((t_s - t_s.mean()) ** 2))
    # The slope is the angular frequency of the flicker, which has twice the ENF.
    return 1 / (4 * math.pi * math.sqrt(of_slope)) if of_slope > 0 else math.inf


@functools.cache
def versions() -> dict[str, str]:
    """Return versions of the program, its sources and libraries, at this process's first call."""
    import av

    folder, digest = Path(rsenf.__file__).parent, hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return {
        "rsenf": rsenf.__version__,
        "source": digest.hexdigest()[:16],
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
        "libavcodec": ".".join(map(str, av.library_versions["libavcodec"])),
    }
