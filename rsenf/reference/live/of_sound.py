"""Mains sound as a reference: from a sound card or a growing WAV file, one frequency a second."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages import ReferenceBlock
from rsenf.messages.schema import FloatArray
from rsenf.reference.live.growing import Growing, OnTheClock
from rsenf.reference.live.of_file import Wait, is_another
from rsenf.reference.wav import MAX_STD_HZ, WavFile, frequencies, open_wav, tenths, tones_within
from rsenf.timebase import NS_PER_S

SETTLE_S = 5  # of sound, from which the tone is chosen
CHUNK_S = 60


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
        if self._tone is None:
            return ""
        nominal_hz, harmonic = self._tones[self._tone]
        return f"{'fundamental' if harmonic == 1 else 'second harmonic'} of {nominal_hz:g} Hz"

    def take(self, samples: FloatArray, arrival_ns: int) -> list[ReferenceBlock]:
        """Take the next samples; return the seconds that they complete.

        Parameters
        ----------
        samples : ndarray of float, shape (n,)
        arrival_ns : int
            Arrival time of the last of them, UTC since 1970.
        """
        self._taken += samples.size
        self._placed.note(self._taken * NS_PER_S // self._rate_hz, arrival_ns)
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
