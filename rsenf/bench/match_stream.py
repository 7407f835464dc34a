"""What the match stage costs while a clip comes in, with results on the way."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.match_days import NOMINAL_HZ, Haystack, clip_of, real_day
from rsenf.bench.memory import HELD, PEAK, memory_mb, restart_peak
from rsenf.match import Match
from rsenf.match.series import Grid, Track
from rsenf.messages import EnfEstimate, Header
from rsenf.timebase import nanoseconds

VERSION = 1
EVERY_S = 60.0


@dataclass(frozen=True)
class Stream:
    """A clip that comes in second by second, searched for in a day every minute."""

    clip_s: int
    seed: int
    folder: Path | None

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        return f"stream {self.clip_s}s {self.seed} v{VERSION}"


def timed_stream(stream: Stream) -> Record:
    """Feed a clip to the stage, to the end."""
    day = real_day(stream.folder, stream.seed)
    grid = Grid("a day", NOMINAL_HZ, 0, 1.0, day.freq_hz)
    track = clip_of(Haystack(1, False, stream.clip_s, stream.seed, stream.folder))
    warm = Match(grids=[grid])
    for estimate in estimates_of(track.between(0, 60)):
        warm.update(estimate)
    warm.flush()
    restart_peak()
    held_mb, stage, results = memory_mb(HELD), Match(grids=[grid], interim_every_s=EVERY_S), []
    began_s = time.process_time()
    for estimate in estimates_of(track):
        results += stage.update(estimate)
    coming_s = time.process_time() - began_s
    results += stage.flush()
    cpu_s, peak_mb = time.process_time() - began_s, memory_mb(PEAK)
    return {
        "version": VERSION,
        "key": stream.key,
        "clip_s": stream.clip_s,
        "results": len(results),
        "matches": sum(result.decision == "match" for result in results),
        "coming_cpu_s": coming_s,
        "cpu_s": cpu_s,
        "peak_mb": peak_mb - held_mb if peak_mb and held_mb else None,
    }


def estimates_of(track: Track, header: Header | None = None) -> Iterator[EnfEstimate]:
    """Yield the messages that would make a track; amplitudes of one level where it has phases."""
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
                estimate,
                carrier_hz=2.0 * track.nominal_hz,
                points=1,
                amplitude_pts_ns=np.array([centre_ns]),
                amplitude_re=np.array([np.cos(phase)]),
                amplitude_im=np.array([np.sin(phase)]),
                amplitude_var_re=var,
                amplitude_var_im=var,
                amplitude_cov=np.zeros(1),
            )
        yield estimate
