"""A reference of any length, written into a store: one measured day, and surrogates of it.

A surrogate has the day's spectrum with random phases (Theiler et al., Physica D 58, 1992): the same
variance and rate of change, but of another time. Days are joined with a jump at midnight. At the
end: the plain loop over the lags of such a reference, with which searches are compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsenf import __version__
from rsenf.bench.calibration.searches import DrawnClip, track_of_clip
from rsenf.bench.harness import timed
from rsenf.bench.scenes import CE_2022
from rsenf.match.ncc import Residuals
from rsenf.match.series import Grid, Track
from rsenf.messages import EnfEstimate, Header
from rsenf.messages.schema import FloatArray
from rsenf.model import synthetic_grid
from rsenf.reference import read_reference
from rsenf.reference.axis import Raster, gathered
from rsenf.reference.store.folder import series_folder
from rsenf.reference.store.sample_file import UNIT_HZ, UNITS_PER_HZ, ImportRecord, SampleWriter
from rsenf.timebase import NS_PER_S, nanoseconds

GRID = "haystack"
NOMINAL_HZ = 50.0
DAY_S = 86400
FIRST_S = 1_735_689_600  # 2025-01-01, UTC
MARGIN_S = 600  # between a day's ends and the clip
LONGEST_CLIP_S = DAY_S - 3 * MARGIN_S
REFERENCE_HZ = 2e-4  # noise of the reference
GAPS_A_DAY, GAP_S = 60, (1.0, 3600.0)  # log-uniform
RUNS, RUN = 20, 1000  # runs of consecutive lags, which represent all lags of a long reference


@dataclass(frozen=True)
class Haystack:
    """A reference of some days, with a clip in the middle one."""

    days: int
    gaps: bool  # one of the middle fifth of the clip among them
    clip_s: int
    seed: int
    folder: Path | None

    @property
    def clip_start_s(self) -> float:
        """Start of the clip, s from the start of the reference."""
        latest_s = DAY_S - MARGIN_S - self.clip_s
        within_s = np.random.default_rng(self.seed).uniform(MARGIN_S, latest_s)
        return self.days // 2 * DAY_S + float(within_s)


def real_day(folder: Path | None, seed: int) -> Grid:
    """Return a measured day, or a synthetic one without the data."""
    path = folder / CE_2022 if folder else None
    if path is None or not path.is_file():
        drawn = synthetic_grid(seed, DAY_S, nominal_hz=NOMINAL_HZ).freq_hz[:DAY_S]
        return Grid("synthetic", NOMINAL_HZ, 0, 1.0, drawn)
    return Grid("continental, 2022-09-17", NOMINAL_HZ, 0, 1.0, read_reference(path).freq_hz)


def clip_of(haystack: Haystack, number: int = 0) -> Track:
    """Simulate a coded clip's estimates; the errors of each number are independent."""
    drawn = DrawnClip(
        start_s=haystack.clip_start_s % DAY_S, seconds=haystack.clip_s, noise_rad=0.05,
        claimed_ratio=1.0, wander_rad=0.0, wander_s=1.0, hole_ratio=0.05, clock_ppm=20.0,
        reference_hz=REFERENCE_HZ,
    )  # fmt: skip
    day = real_day(haystack.folder, haystack.seed)
    return track_of_clip(day, drawn, np.random.default_rng([haystack.seed, 1, number]))


def estimates_of(track: Track, header: Header | None = None) -> Iterator[EnfEstimate]:
    """Yield a track's estimates as messages, with unit amplitudes where it has phases.

    Parameters
    ----------
    header : Header, optional
        Of the first message.
    """
    half_ns, header = nanoseconds(track.window_s / 2), header or Header()
    for i, enf_hz in enumerate(track.enf_hz):
        centre_ns = nanoseconds(track.first_s + i * track.hop_s)
        estimate = EnfEstimate(
            header=replace(header, seq=header.seq + i),
            nominal_hz=track.nominal_hz,
            start_pts_ns=centre_ns - half_ns,
            end_pts_ns=centre_ns + half_ns,
            enf_hz=float(enf_hz),
            enf_var_hz2=float(track.var_hz2[i]),
            usable=bool(np.isfinite(enf_hz)),
        )
        phase, var = track.phase_rad[i], np.array([track.phase_var_rad2[i]])
        if np.isfinite(phase):
            estimate = replace(
                estimate, carrier_hz=2.0 * track.nominal_hz, points=1,
                amplitude_pts_ns=np.array([centre_ns]), amplitude_re=np.array([np.cos(phase)]),
                amplitude_im=np.array([np.sin(phase)]), amplitude_var_re=var,
                amplitude_var_im=var, amplitude_cov=np.zeros(1),
            )  # fmt: skip
        yield estimate


def write_haystack(haystack: Haystack, store: Path) -> None:
    """Write the reference into a store, day by day in constant memory.

    Parameters
    ----------
    store : Path
        An empty folder.
    """
    raster = Raster(0, NS_PER_S)
    folder = series_folder(store, GRID, NS_PER_S)
    folder.mkdir(parents=True)
    with closing(SampleWriter(folder / "0.parquet", raster)) as writer:
        for number, freq_hz in enumerate(_days(haystack)):
            index = FIRST_S + number * DAY_S + np.arange(DAY_S)
            there = np.isfinite(freq_hz)
            away = np.rint((freq_hz[there] - NOMINAL_HZ) * UNITS_PER_HZ).astype(np.int64)
            writer.add(gathered(index[there], away, UNIT_HZ))
        writer.flush()
        record = ImportRecord(
            grid=GRID, nominal_hz=NOMINAL_HZ, step_ns=raster.step_ns, phase_ns=raster.t0_ns,
            name="made by rsenf bench match", sha256="", size_bytes=0, options={}, imported_utc="",
            rsenf=__version__, rows=writer.samples, samples=writer.samples, notes=(),
        )  # fmt: skip
        writer.finish(record)


def _days(haystack: Haystack) -> Iterator[FloatArray]:
    real = real_day(haystack.folder, haystack.seed).freq_hz
    for number in range(haystack.days):
        rng = np.random.default_rng([haystack.seed, 2, number])
        day = real if number == haystack.days // 2 else _like(real, rng)
        day = day + REFERENCE_HZ * rng.standard_normal(DAY_S)
        if haystack.gaps:
            missing = np.zeros(DAY_S, bool)
            for start in rng.integers(0, DAY_S, GAPS_A_DAY):
                missing[start : start + int(np.exp(rng.uniform(*np.log(GAP_S))))] = True
            if number == haystack.days // 2:
                begin = int(haystack.clip_start_s % DAY_S)
                clip = missing[begin : begin + haystack.clip_s + 1]
                clip[:] = False
                clip[2 * haystack.clip_s // 5 : 3 * haystack.clip_s // 5] = True
            day[missing] = np.nan
        yield day


def _like(freq_hz: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw a surrogate of a series: the same amplitude spectrum, random phases."""
    spectrum = np.fft.rfft(freq_hz - freq_hz.mean())
    turned = np.abs(spectrum) * np.exp(2j * np.pi * rng.random(spectrum.size))
    return np.asarray(freq_hz.mean() + np.fft.irfft(turned, freq_hz.size), np.float64)


def lag_by_lag(
    clip_hz: FloatArray, reference_hz: FloatArray, first: int, count: int, least: int
) -> Residuals:
    """Compute :func:`rsenf.match.ncc.lag_residuals` for consecutive lags in a plain loop.

    Parameters
    ----------
    clip_hz, reference_hz : ndarray, shapes (n,) and (N,)
        With one step; NaN in gaps.
    first, count, least : int
        First lag, number of lags, and least number of pairs of a lag that is compared.
    """
    pairs = np.zeros(count, np.int64)
    offset, var = np.full((2, count), np.nan)
    for k, lag in enumerate(range(first, first + count)):
        a, b = max(-lag, 0), min(clip_hz.size, reference_hz.size - lag)
        apart = clip_hz[a:b] - reference_hz[a + lag : b + lag]
        apart = apart[np.isfinite(apart)]
        pairs[k] = apart.size
        if apart.size >= least:
            offset[k], var[k] = apart.mean(), apart.var()
    return Residuals(first, pairs, offset, var)


def loop_cpu_s(
    clip_hz: FloatArray, reference_hz: FloatArray, lags: int, least: int, seed: int
) -> float:
    """Return the processor time of the loop over ``lags``, s, extrapolated from drawn runs."""
    rng, length = np.random.default_rng([seed, 3]), RUN + clip_hz.size
    starts = np.sort(rng.integers(0, reference_hz.size - length, RUNS))
    parts = [np.asarray(reference_hz[a : a + length]) for a in starts]
    _, cpu_s = timed(lambda: [lag_by_lag(clip_hz, part, 0, RUN, least) for part in parts])
    return cpu_s * lags / (RUN * RUNS)
