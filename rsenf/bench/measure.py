"""One clip, from its seed to its record.

It is rendered once; row blocks come from the raw frames, and from every encoding after decoding.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import math
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rsenf
from rsenf.bench.judge import judge_enf, judge_idle
from rsenf.bench.plan import LIT, Clip, codec_of
from rsenf.bench.scenes import Setting, grid_for, setting_of
from rsenf.decode import SourceSpec, open_source
from rsenf.idle.coherent import idle_ratio_bound
from rsenf.messages import Frame, Header, RowBlock
from rsenf.model import FrameStream, GridPath, write_videos
from rsenf.model.exposures import Capture
from rsenf.model.noise import QUANTISATION_VAR
from rsenf.rows.stage import Rows
from rsenf.timebase import pts_to_ns

Luma = NDArray[np.uint8]


@dataclass(eq=False)
class Filmed:
    """A clip as row blocks."""

    truth: dict[str, Any]
    blocks: dict[str, list[RowBlock]] = field(default_factory=dict)  # by coding
    # Processor time of `film` (rendering, encoding) and `decode` (decoding, sampling).
    cpu_s: dict[str, float] = field(default_factory=dict)


class _Shown(FrameStream):
    """The frames of a clip; a callback gets each one before the encoders do."""

    def __init__(self, capture: Capture, show: Callable[[int, int, Luma], None]) -> None:
        super().__init__(capture)
        self._show = show

    def __iter__(self) -> Iterator[tuple[int, Luma]]:
        for number, (pts, luma) in enumerate(super().__iter__()):
            self._show(number, pts_to_ns(pts, self.time_base), luma)
            yield pts, luma


def film(setting: Setting, grid: GridPath, duration_s: float, codings: Sequence[str]) -> Filmed:
    """Film a clip, encode it in the same pass, decode, and sample the rows of every coding.

    Rows of the lossless coding are sampled from the raw frames. Encoded files are temporary.
    """
    begin_s = time.process_time()
    rows, blocks = Rows(), []

    def sample(number: int, pts_ns: int, luma: Luma) -> None:
        height, width = luma.shape
        header = Header(frame_first=number, frame_last=number, seq=number, pts_ns=pts_ns)
        blocks.extend(
            rows.update(Frame(header=header, height_px=height, width_px=width, luma=luma))
        )

    frames = _Shown(Capture(setting.model, grid, duration_s, setting.seed), sample)
    filmed = Filmed(truth=frames.truth)
    codecs = {coding: codec_of(coding) for coding in codings}
    with tempfile.TemporaryDirectory(prefix="rsenf-bench-") as folder:
        files = {coding: Path(folder) / f"{coding}.mp4" for coding in codings}
        write_videos({files[c]: codec for c, codec in codecs.items() if codec}, frames)
        filmed.cpu_s["film"] = time.process_time() - begin_s
        begin_s, blocks = time.process_time(), blocks + rows.flush()
        for coding, codec in codecs.items():
            filmed.blocks[coding] = decoded(files[coding]) if codec else blocks
        filmed.cpu_s["decode"] = time.process_time() - begin_s
    return filmed


def decoded(path: Path) -> list[RowBlock]:
    """Decode a video file and sample its rows with the default settings."""
    rows, blocks = Rows(), []
    # One thread: several clips are measured in parallel.
    spec = SourceSpec(url=str(path), kind="file", threads=1)
    with open_source(spec, source="", run_id="", clock_ns=lambda: 0) as frames:
        for frame in frames:
            assert isinstance(frame, Frame)  # packets come only on request
            blocks += rows.update(frame)
    return blocks + rows.flush()


VERSION = 1
_LIBRARIES = ("av", "numpy", "opencv-python-headless", "scipy")


def measure(clip: Clip, grids: Path | None) -> dict[str, Any]:
    """Film a clip and run every method on it; return the record, as plain values.

    Parameters
    ----------
    clip : Clip
    grids : Path or None
        Folder of measured grids.
    """
    begin_s, made_by = time.perf_counter(), versions()
    setting = setting_of(clip)
    grid, grid_name = grid_for(grids, clip.nominal_hz, clip.duration_s, clip.generator("grid"))
    filmed = film(setting, grid, clip.duration_s, clip.codings)
    truth = filmed.truth
    found = {
        coding: {"idle": judge_idle(blocks, truth["idle_ratio"]), "enf": judge_enf(blocks, grid)}
        for coding, blocks in filmed.blocks.items()
    }
    return {
        "version": VERSION,
        "key": clip.key,
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
        "found": found,
        "cpu_s": {step: round(s, 2) for step, s in filmed.cpu_s.items()},
        "wall_s": round(time.perf_counter() - begin_s, 2),
        "versions": made_by,
    }


def _lit_facts(clip: Clip, setting: Setting, grid: GridPath) -> dict[str, Any]:
    """Return flicker, noise and the Cramér–Rao bounds of a clip with a lamp."""
    model, shutter = setting.model, setting.model.shutter
    levels = setting.flicker_levels(clip.nominal_hz)
    pixel_var = model.sensor.variance(np.array([model.scene.level], np.float32)) + QUANTISATION_VAR
    row_noise = float(np.sqrt(pixel_var[0] / shutter.across_px))
    rate_hz = float(shutter.frame_rate)
    enf_hz = enf_bound_hz(
        noise_level=row_noise, amplitude_level=levels, rows=shutter.rows, frame_rate_hz=rate_hz,
        read_out_time_s=shutter.read_out_time_s,
    )  # fmt: skip
    idle = idle_ratio_bound(
        noise_level=row_noise, amplitude_level=levels, rows=shutter.rows, frame_rate_hz=rate_hz,
        frames=round(clip.duration_s * shutter.frame_rate), f0_hz=2 * clip.nominal_hz,
    )  # fmt: skip
    return {
        "flicker_level": levels[0],
        "row_noise_level": row_noise,
        "alias_turn_rad": _alias_turn_rad(clip, rate_hz, grid),
        "enf_bound_mhz": 1e3 * enf_hz,
        "idle_bound_percent": 100 * idle,
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
    (Rife and Boorstyn 1974, here for samples at any times). Harmonic ``k`` has ``k`` times
    the phase, so a sample has Fisher information ``Σ (k·A_k)² / 2σ²`` on it. An estimator that also
    uses the time before and after can have a smaller error, since the ENF varies slowly.

    Parameters
    ----------
    noise_level : float
        Standard deviation of the noise of one row's mean, levels.
    amplitude_level : sequence of float
        Amplitudes of the harmonics 1, 2, … of the flicker, levels.
    rows : int
        Of a frame.
    frame_rate_hz, read_out_time_s : float
    seconds : float
        Length of the interval.

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


def _alias_turn_rad(clip: Clip, frame_rate_hz: float, grid: GridPath) -> float:
    """Return the range of the phase of the flicker's alias at the frame rate over the clip, rad.

    Where the alias is at 0 Hz, only the grid's deviation moves it; below 1 rad, flicker can't be
    separated from texture.
    """
    t_s = np.arange(0.0, clip.duration_s, 1 / frame_rate_hz)
    beside = round(2 * clip.nominal_hz / frame_rate_hz) * frame_rate_hz
    return float(np.ptp(2 * np.pi * (2 * grid.cycles(t_s) - beside * t_s)))


@functools.cache
def versions() -> dict[str, str]:
    """Return versions of the program and its libraries, at this process's first call.

    ``source`` is a hash of the program's source files.
    """
    import av

    folder = Path(rsenf.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())

    return {
        "rsenf": rsenf.__version__,
        "source": digest.hexdigest()[:16],
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
        "libavcodec": ".".join(map(str, av.library_versions["libavcodec"])),
    }
