"""Publishes references that are still being measured: from a camera, topic, sound card or file.

A sound card is read in blocks of samples with their arrival times.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any, NamedTuple

import numpy as np

from rsenf.bus.keys import camera_key
from rsenf.errors import UsageError
from rsenf.messages import Header, Mark, ReferenceBlock
from rsenf.messages.schema import FloatArray
from rsenf.reference.live import (
    CameraReference,
    Growing,
    RelayedReference,
    SoundReference,
    follow_table,
    follow_wav,
)
from rsenf.reference.reference import Notes
from rsenf.run.node import NodeProcess
from rsenf.run.pump import Lane, pump
from rsenf.run.runner import Runner
from rsenf.stage import Stage

# Without samples for so long, the device is gone.
SILENCE_S = 5.0
BACKOFF_S = (1.0, 30.0)
CARD_POLL_S = 0.1
WAITING = 256  # blocks of samples


class Sound(NamedTuple):
    """Samples (n,), and the arrival time of the last of them (UTC since 1970, ns)."""

    samples: FloatArray
    arrival_ns: int
    rate_hz: int
    after_loss: bool  # whether samples are missing before these


class Opened(NamedTuple):
    """An open input; its ``stream`` is closed when left."""

    stream: AbstractContextManager[Any]
    rate_hz: int


# Takes a device, and a function to call with samples (n,) and with whether some were lost before.
Input = Callable[[str, Callable[[FloatArray, bool], None]], Opened]


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
        with ExitStack() as started:
            started.callback(stream.close)
            stream.start()
            return Opened(started.pop_all(), rate_hz)
    except (sounddevice.PortAudioError, ValueError) as exc:
        raise UsageError(
            f"no sound from {device or 'the usual input'!r}: {str(exc).splitlines()[0]}",
            "python -m sounddevice lists what there is",
        ) from None


def listen(
    device: str,
    stop: Event,
    on_event: Callable[[str], None],
    clock_ns: Callable[[], int] = time.time_ns,
    open_: Input = open_input,
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
            samples, arrival_ns, lost = heard.get(timeout=CARD_POLL_S)
        except queue.Empty:
            continue
        since_s = time.monotonic()
        yield samples, arrival_ns, lost or first
        first = False


POLL_S = 0.25  # interval of checking a growing file


def publish_feed(node: NodeProcess) -> None:
    """Publish a growing reference until its source ends or the node is told to stop.

    Raises
    ------
    UsageError
        When the source can't be opened.
    """
    config = node.config
    kind, name = config.feed
    site, grid = node.graph.site, config.grid
    if kind == "camera":
        step_s = config.step_s or 1.0
        senders = {
            camera_key(site, name, topic): node.sender_of(topic, name)
            for topic in ("rows", "track")
        }
        _relay(node, senders, CameraReference(grid, step_s, node.run_id), Notes())
    elif kind == "topic":
        site, grid_there = name.split("/")[1::2]
        sender = node.sender_of("reference", grid_there) if site == node.graph.site else ""
        stage = RelayedReference(grid, node.run_id, config.nominal_hz)
        _relay(node, {name: sender}, stage, stage.notes)
    elif kind == "sound":
        _publish(node, _heard(node, config, name))
    else:
        _publish(node, _grown(node, config))


@dataclass(kw_only=True)
class _NotedLane(Lane):
    """A lane whose stage notes what it leaves out; the notes appear in the node's health."""

    notes: Notes
    _said: str = ""

    def send(self, messages: Iterable[Any]) -> None:
        """Send messages; report new notes."""
        super().send(messages)
        noted = "; ".join(self.notes.lines)
        if noted != self._said:
            self._said = noted
            self.node.say("running", noted)


def _relay(node: NodeProcess, senders: dict[str, str], stage: Stage, notes: Notes) -> None:
    """Make the reference of other topics; ``senders`` maps their keys to the sending nodes."""
    lane = _NotedLane(
        node=node,
        # The reference continues over epochs of its inputs: one stage serves all of them.
        runner=Runner("reference", lambda: stage, inputs=len(senders)),
        publishers={ReferenceBlock: node.reference_publisher(node.config.grid)},
        inputs={node.subscribe(key): sender for key, sender in senders.items()},
        notes=notes,
    )
    node.ready()
    pump(node, [lane])


def _publish(node: NodeProcess, blocks: Iterable[ReferenceBlock]) -> None:
    """Publish blocks as they come, then an END mark."""
    grid = node.config.grid
    publisher = node.reference_publisher(grid)
    node.ready()
    header = Header(run_id=node.run_id, source=f"reference/{grid}", seq=-1)
    for block in blocks:
        header = block.header
        node.note_input(header)
        publisher.send(block)
        if node.stop.is_set():  # a file's present content may take long
            break
    publisher.send(ReferenceBlock(header=header.numbered(header.seq + 1, Mark.END)))


def _grown(node: NodeProcess, config: Any) -> Iterator[ReferenceBlock]:
    """Return the blocks of a growing file."""
    path, grid, nominal_hz = Path(config.input), config.grid, config.nominal_hz

    def wait() -> bool:
        return node.stop.wait(POLL_S)

    if path.suffix.lower() == ".wav":
        return follow_wav(path, grid, nominal_hz, wait, node.run_id)
    return follow_table(path, grid, config.reading, wait, node.run_id)


def _heard(node: NodeProcess, config: Any, device: str) -> Iterator[ReferenceBlock]:
    """Yield blocks measured from a sound card's input; report which tone they are based on."""
    growing = Growing(config.grid, run_id=node.run_id)
    reference: SoundReference | None = None
    tone = ""

    def say(line: str) -> None:
        node.say("running", line)

    for sound in listen(device, node.stop, say):
        if reference is None:
            reference = SoundReference(growing, sound.rate_hz, config.nominal_hz)
        elif sound.after_loss:
            reference.lost()
        yield from reference.take(sound.samples, sound.arrival_ns)
        if reference.tone != tone:
            tone = reference.tone
            say(f"{tone} heard")
