"""Live references from measurements: a camera's ENF estimates, another node's reference, or sound.

Mains sound comes from a sound card or a growing WAV file, one frequency a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages import EnfEstimate, ReferenceBlock, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.reference.live.growing import Growing, OnTheClock, Wait, is_another
from rsenf.reference.plausible import NOMINALS_HZ, without_outliers
from rsenf.reference.reference import Notes
from rsenf.reference.wav import (
    MAX_STD_HZ,
    WavFile,
    frequencies,
    open_wav,
    tenths,
    tone_text,
    tones_within,
)
from rsenf.timebase import NS_PER_S

MAX_SAMPLES = 1_000_000  # of a message
# A gap of up to a day is filled sample by sample: a finer step would fill the memory.
MIN_STEP_NS, MAX_STEP_NS = NS_PER_S // 100, 60 * NS_PER_S
SETTLE_S = 5  # of sound, from which the tone is chosen
CHUNK_S = 60


class CameraReference:
    """Makes a reference from a camera's row blocks and estimates. A :class:`rsenf.stage.Stage`.

    Row blocks only supply the arrival times of their frames. Without them those of the estimates
    are used, which are later.

    Parameters
    ----------
    grid : str
        Name of the reference.
    step_s : float
        Time between samples; the hop of the camera's estimates.
    run_id : str
        Identity of the run.
    """

    def __init__(self, grid: str, step_s: float = 1.0, run_id: str = "") -> None:
        self._growing = Growing(grid, step_s, run_id)
        self._placed = OnTheClock(self._growing)
        self._stream: tuple[str, int] | None = None

    def update(self, message: EnfEstimate | RowBlock) -> list[ReferenceBlock]:
        """Take a message of the camera; return the samples that it completes."""
        header = message.header
        stream = header.run_id, header.epoch
        # A tracker that was restarted extends the name of the rows' run by one of its own.
        of = header.run_id.rpartition(".")[0], header.epoch
        if stream != self._stream and (isinstance(message, RowBlock) or of != self._stream):
            self._stream = stream
            self._placed.new_stream()
        if isinstance(message, RowBlock):
            self._placed.clock.note(header.pts_ns, header.arrival_time_ns)
            return []
        if message.rank != 0 or not message.nominal_hz > 0:
            return []
        self._placed.clock.note(message.end_pts_ns, header.arrival_time_ns)
        # A sample has the same centre as its estimate, whatever the window.
        start_ns = (message.start_pts_ns + message.end_pts_ns - self._growing.step_ns) // 2
        good = message.usable and message.enf_var_hz2 <= MAX_STD_HZ**2
        freq_hz = message.enf_hz if good else float("nan")
        return self._placed.sample(start_ns, freq_hz, message.nominal_hz)

    def flush(self) -> list[ReferenceBlock]:
        """Return nothing: each sample is sent as soon as it is known."""
        return []


class RelayedReference:
    """Makes a reference from another one's blocks. A :class:`rsenf.stage.Stage`.

    Blocks that can't be a grid's frequency, have no time, or have another step than the first are
    dropped and counted.

    Parameters
    ----------
    grid : str
        Name of the new reference.
    run_id : str
        Identity of the run.
    nominal_hz : float, optional
        Required nominal frequency; that of the first block (50 or 60) if None.

    Attributes
    ----------
    notes : Notes
        Number of dropped blocks by reason, and of outliers.
    """

    def __init__(self, grid: str, run_id: str = "", nominal_hz: float | None = None) -> None:
        self._grid, self._run_id, self._nominal_hz = grid, run_id, nominal_hz
        self._growing: Growing | None = None
        self.notes = Notes()

    def update(self, message: ReferenceBlock) -> list[ReferenceBlock]:
        """Take a block; return it as blocks of this reference."""
        if why := self._why_not(message):
            self.notes.count(f"blocks left out: {why}", 1)
            return []
        if self._growing is None:
            self._nominal_hz = message.nominal_hz
            self._growing = Growing(self._grid, message.step_ns / NS_PER_S, self._run_id)
        self._growing.zone_unknown = message.zone_unknown
        index = np.arange(message.first, message.first + message.samples)
        freq_hz = without_outliers(message.freq_hz, message.nominal_hz, self.notes)
        t_ns = message.t0_ns + index * message.step_ns
        return self._growing.stamped(t_ns, freq_hz, message.nominal_hz)

    def flush(self) -> list[ReferenceBlock]:
        """Return nothing: each sample is sent when it arrives."""
        return []

    def _why_not(self, block: ReferenceBlock) -> str:
        if block.t0_ns <= 0:
            return "they tell no time"
        if block.nominal_hz not in NOMINALS_HZ or self._nominal_hz not in (None, block.nominal_hz):
            return "they are of another nominal frequency"
        if not MIN_STEP_NS <= block.step_ns <= MAX_STEP_NS:
            return "the time between their samples can't be"
        if self._growing and block.step_ns != self._growing.step_ns:
            return "the time between their samples changes"
        if not 0 < block.samples == block.freq_hz.size <= MAX_SAMPLES or block.first < 0:
            return "their samples can't be counted"
        if block.t0_ns + (block.first + block.samples) * block.step_ns > 2**63 - 1:
            return "they are of no time that can be"
        return ""


class SoundReference:
    """Estimates the grid's frequency from a recording of the mains while it is made.

    The estimator is that of :mod:`rsenf.reference.wav`. The first seconds with a clear tone select
    the tone to follow: 50 or 60 Hz, or the second harmonic of one of them.

    Parameters
    ----------
    growing : Growing
        Receives the samples.
    rate_hz : int
        Sampling rate, at least 250.
    nominal_hz : float, optional
        50 or 60; the one that is found if None.

    Raises
    ------
    ReferenceFormatError
        If the sampling rate is too low for any tone of the mains.
    """

    def __init__(self, growing: Growing, rate_hz: int, nominal_hz: float | None = None) -> None:
        self._tones = tones_within(rate_hz, nominal_hz)
        if not self._tones:
            raise ReferenceFormatError(
                f"sound of {rate_hz} samples a second", "the mains need 250 or more"
            )
        self._rate_hz = rate_hz
        self._placed = OnTheClock(growing)
        self._tone: int | None = None
        self._lost()

    def _lost(self) -> None:
        self._rest = np.empty(0)
        self._taken = self._second = 0
        self._held: list[tuple[FloatArray, FloatArray]] = []

    def lost(self) -> None:
        """Restart after lost samples: the next second is placed by the wall clock."""
        self._lost()
        self._placed.new_stream()

    @property
    def tone(self) -> str:
        """The tone that is followed; empty until one is found."""
        return "" if self._tone is None else tone_text(*self._tones[self._tone])

    def take(self, samples: FloatArray, arrival_ns: int) -> list[ReferenceBlock]:
        """Take the next samples; return the seconds that they complete.

        Parameters
        ----------
        samples : ndarray of float, shape (n,)
        arrival_ns : int
            Arrival time of the last of them, UTC since 1970.
        """
        self._taken += samples.size
        self._placed.clock.note(self._taken * NS_PER_S // self._rate_hz, arrival_ns)
        self._rest = np.concatenate([self._rest, samples])
        whole = self._rest.size // self._rate_hz * self._rate_hz
        seconds, self._rest = self._rest[:whole].reshape(-1, self._rate_hz), self._rest[whole:]
        return [block for second in seconds for block in self._take_second(second)]

    def _take_second(self, samples: FloatArray) -> list[ReferenceBlock]:
        carriers_hz = [n * h for n, h in self._tones]
        found = [frequencies(z) for z in tenths(samples, self._rate_hz, carriers_hz)]
        offset_hz, std_hz = (np.array([f[i][0] for f in found]) for i in (0, 1))
        # Converted to ENF: the second harmonic deviates twice as far.
        harmonics = np.array([h for _, h in self._tones])
        self._held.append((offset_hz / harmonics, std_hz / harmonics))
        if self._tone is None and not self._choose():
            if len(self._held) >= SETTLE_S:
                del self._held[0]
                self._second += 1
            return []
        out = [block for offset, std in self._held for block in self._tell(offset, std)]
        self._held = []
        return out

    def _choose(self) -> bool:
        """Choose the tone with the smallest standard error, after enough seconds with one."""
        errors = np.median([std for _, std in self._held], axis=0)
        best = int(np.argmin(errors))
        if len(self._held) >= SETTLE_S and errors[best] <= MAX_STD_HZ:
            self._tone = best
        return self._tone is not None

    def _tell(self, offset_hz: FloatArray, std_hz: FloatArray) -> list[ReferenceBlock]:
        tone, second = self._tone or 0, self._second
        self._second += 1
        nominal_hz = self._tones[tone][0]
        good = std_hz[tone] <= MAX_STD_HZ
        freq_hz = nominal_hz + float(offset_hz[tone]) if good else float("nan")
        return self._placed.sample(second * NS_PER_S, freq_hz, nominal_hz)


def follow_wav(
    path: Path, grid: str, nominal_hz: float | None, wait: Wait, run_id: str = ""
) -> Iterator[ReferenceBlock]:
    """Return the frequency of a WAV file of the mains as blocks, and continue as it grows.

    The file's modification time dates its last samples.

    Parameters
    ----------
    path : Path
    grid : str
        Name of the reference.
    nominal_hz : float, optional
        50 or 60; the one that is found if None.
    wait : callable
        Called when there is nothing new; waits a while, and returns whether to stop.
    run_id : str
        Identity of the run.

    Raises
    ------
    ReferenceFormatError
        If the file can't be read.
    """
    growing = Growing(grid, run_id=run_id)
    SoundReference(growing, open_wav(path).rate_hz, nominal_hz)  # checks the arguments
    return _followed(path, growing, nominal_hz, wait)


def _followed(
    path: Path, growing: Growing, nominal_hz: float | None, wait: Wait
) -> Iterator[ReferenceBlock]:
    while True:
        try:
            with path.open("rb") as file:
                wav, done = open_wav(path), 0
                sound = SoundReference(growing, wav.rate_hz, nominal_hz)
                while not is_another(path, file, wav.start + done * wav.frame_bytes):
                    wav = open_wav(path)
                    yield from _new_of(wav, done, sound)
                    done = max(wav.frames, done)
                    if wait():
                        return
        except (OSError, ReferenceFormatError):  # removed, and not yet replaced
            if wait():
                return


def _new_of(wav: WavFile, done: int, sound: SoundReference) -> Iterator[ReferenceBlock]:
    """Feed new samples, each minute with its arrival time."""
    changed_ns = wav.path.stat().st_mtime_ns
    for samples in wav.first_channel(CHUNK_S * wav.rate_hz, done):
        done += samples.size
        remaining_ns = (wav.frames - done) * NS_PER_S // wav.rate_hz
        yield from sound.take(samples, changed_ns - remaining_ns)
