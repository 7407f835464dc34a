"""Sound card input: blocks of samples with their arrival times."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from threading import Event
from typing import Any, NamedTuple

import numpy as np

from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray

# Without samples for so long, the device is gone.
SILENCE_S = 5.0
BACKOFF_S = (1.0, 30.0)
POLL_S = 0.1
WAITING = 256  # blocks of samples


class Sound(NamedTuple):
    """Samples (n,), and the arrival time of the last of them (UTC since 1970, ns)."""

    samples: FloatArray
    arrival_ns: int
    rate_hz: int
    after_loss: bool  # whether samples are missing before these


class Opened(NamedTuple):
    """An open input; its ``stream`` is started when entered and closed when left."""

    stream: AbstractContextManager[Any]
    rate_hz: int


# Takes a device, and a function to call with samples (n,) and with whether some were lost before.
OpenInput = Callable[[str, Callable[[FloatArray, bool], None]], Opened]


def open_input(device: str, take: Callable[[FloatArray, bool], None]) -> Opened:
    """Open an input of the sound card.

    Parameters
    ----------
    device : str
        Its number or a part of its name; '' for the default input.
    take : callable
        Called from the sound library's thread with samples (n,), and with whether some were lost.

    Raises
    ------
    UsageError
        When the library isn't installed, or there is no such input.
    """
    try:
        import sounddevice
    except ModuleNotFoundError:
        raise UsageError(
            "sound needs a library that isn't installed", "pip install 'rsenf[sound]'"
        ) from None
    except OSError:  # raised when PortAudio is missing
        raise UsageError("sound needs PortAudio", "on Debian: apt install libportaudio2") from None

    def callback(samples: Any, _frames: int, _time: Any, status: Any) -> None:
        take(np.array(samples[:, 0], np.float64), bool(status.input_overflow))

    wanted: Any = int(device) if device.isdigit() else device or None
    try:
        rate_hz = round(sounddevice.query_devices(wanted, "input")["default_samplerate"])
        stream = sounddevice.InputStream(
            samplerate=rate_hz, device=wanted, channels=1, dtype="float32", callback=callback
        )
    except (sounddevice.PortAudioError, ValueError) as exc:
        raise UsageError(
            f"no sound from {device or 'the usual input'!r}: {str(exc).splitlines()[0]}",
            "python -m sounddevice lists what there is",
        ) from None
    return Opened(stream, rate_hz)


def listen(
    device: str,
    stop: Event,
    on_event: Callable[[str], None],
    clock_ns: Callable[[], int] = time.time_ns,
    open_: OpenInput = open_input,
) -> Iterator[Sound]:
    """Yield sound until stopped; reopen the device with backoff when it is lost.

    Parameters
    ----------
    device : str
        As for :func:`open_input`.
    stop : Event
        Ends the iteration.
    on_event : callable
        Called with one line of text when the device is lost.
    clock_ns : callable
        The host's wall clock, ns.
    open_ : callable
        Opens the device.

    Raises
    ------
    UsageError
        When the device can't be opened at the first attempt.
    """
    back_s, is_first = BACKOFF_S[0], True
    while not stop.is_set():
        heard: queue.Queue[tuple[FloatArray, int, bool]] = queue.Queue(WAITING)
        try:
            opened = open_(device, _taking(heard, clock_ns))
            with opened.stream:
                for samples, arrival_ns, lost in _until_silent(heard, stop):
                    yield Sound(samples, arrival_ns, opened.rate_hz, lost)
                    back_s = BACKOFF_S[0]
            why = f"no sound for {SILENCE_S:g} s"
        except UsageError as exc:
            if is_first:
                raise
            why = exc.message
        is_first = False
        if not stop.is_set():
            on_event(f"{why}; next attempt in {back_s:g} s")
            stop.wait(back_s)
            back_s = min(2 * back_s, BACKOFF_S[1])


def _taking(
    heard: queue.Queue[tuple[FloatArray, int, bool]], clock_ns: Callable[[], int]
) -> Callable[[FloatArray, bool], None]:
    """Return the callback for the sound library's thread; with a full queue it drops samples."""
    dropped = False

    def take(samples: FloatArray, lost: bool) -> None:
        nonlocal dropped
        try:
            heard.put_nowait((samples, clock_ns(), lost or dropped))
            dropped = False
        except queue.Full:
            dropped = True

    return take


def _until_silent(
    heard: queue.Queue[tuple[FloatArray, int, bool]], stop: Event
) -> Iterator[tuple[FloatArray, int, bool]]:
    """Yield blocks until none comes for ``SILENCE_S``; the first one is marked as after a loss."""
    since_s, first = time.monotonic(), True
    while not stop.is_set() and time.monotonic() - since_s < SILENCE_S:
        try:
            samples, arrival_ns, lost = heard.get(timeout=POLL_S)
        except queue.Empty:
            continue
        since_s = time.monotonic()
        yield samples, arrival_ns, lost or first
        first = False
