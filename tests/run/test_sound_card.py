"""The mains through a sound card, which is played by the test: it starts, is lost, comes back."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Callable, Iterator
from threading import Event, Thread
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.reference.live import Growing, SoundReference
from rsenf.run import reference_feeds
from rsenf.run.reference_feeds import Opened, listen, open_input
from rsenf.timebase import NS_PER_S
from tests.reference.joined import joined
from tests.reference.test_wav import mains, path_hz

RATE_HZ = 1000
T0_NS = 1_700_000_000 * NS_PER_S


def test_sound_becomes_seconds_of_reference() -> None:
    truth = path_hz(60)
    signal = mains(truth, RATE_HZ, harmonic=2)
    growing = Growing("ce")
    sound, blocks = SoundReference(growing, RATE_HZ), []
    rng = np.random.default_rng(4)
    for first in range(0, signal.size, 130):
        piece = signal[first : first + 130]
        late_ns = int(rng.exponential(2e7))
        arrival_ns = T0_NS + (first + piece.size) * 10**6 + late_ns
        blocks += sound.take(piece, arrival_ns)
    assert sound.tone == "second harmonic of 50 Hz"
    reference = joined(blocks)
    np.testing.assert_allclose(reference.freq_hz, truth, atol=2e-4)
    assert abs(reference.t0_ns - T0_NS) < 0.05 * NS_PER_S
    # Ten seconds were lost: a gap, then on.
    sound.lost()
    for first in range(0, 7000, 100):
        arrival_ns = T0_NS + 70 * NS_PER_S + (first + 100) * 10**6
        blocks += sound.take(signal[first : first + 100], arrival_ns)
    freq_hz = joined(blocks).freq_hz
    assert np.isnan(freq_hz[60:70]).all()
    np.testing.assert_allclose(freq_hz[70:], truth[:7], atol=2e-4)


def test_noise_is_no_reference() -> None:
    sound = SoundReference(Growing("ce"), RATE_HZ)
    noise = np.random.default_rng(0).standard_normal(30 * RATE_HZ)
    assert sound.take(noise, T0_NS) == []
    assert sound.tone == ""


class Card:
    """A sound card: each opening goes as listed, and brings a second of silence in pieces."""

    def __init__(self, *goes: bool) -> None:
        self._goes = iter(goes)

    def open(self, device: str, take: Callable[[FloatArray, bool], None]) -> Opened:
        if not next(self._goes, False):
            raise UsageError("no sound from 'usb'")

        @contextlib.contextmanager
        def running() -> Iterator[None]:
            for k in range(3):
                take(np.zeros(100), k == 2)
            yield

        return Opened(running(), RATE_HZ)


def test_a_device_that_is_lost_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference_feeds, "SILENCE_S", 0.05)
    monkeypatch.setattr(reference_feeds, "BACKOFF_S", (0.01, 0.02))
    stop, events, heard = Event(), [], []
    for sound in listen("usb", stop, events.append, lambda: 7, Card(True, False, True).open):
        heard.append((sound.samples.size, sound.arrival_ns, sound.rate_hz, sound.after_loss))
        if len(heard) == 6:
            stop.set()
    assert heard == 2 * [(100, 7, RATE_HZ, True), (100, 7, RATE_HZ, False), (100, 7, RATE_HZ, True)]
    assert events == [
        "no sound for 0.05 s; next attempt in 0.01 s",
        "no sound from 'usb'; next attempt in 0.02 s",
    ]
    with pytest.raises(UsageError, match="no sound from"):
        list(listen("usb", Event(), events.append, lambda: 7, Card(False).open))


class Absent:
    """In the place of a module that can't be imported."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def find_spec(self, name: str, *more: Any) -> None:
        if name == "sounddevice":
            raise self.error


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (ModuleNotFoundError("No module named 'sounddevice'"), "pip install 'rsenf\\[sound\\]'"),
        (OSError("PortAudio library not found"), "libportaudio2"),
    ],
)
def test_what_is_missing_is_said_in_a_line(
    monkeypatch: pytest.MonkeyPatch, error: Exception, says: str
) -> None:
    monkeypatch.delitem(sys.modules, "sounddevice", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Absent(error), *sys.meta_path])
    with pytest.raises(UsageError, match=says):
        open_input("", lambda samples, lost: None)


@pytest.mark.external
def test_a_device_that_is_not_there() -> None:
    try:
        importlib.import_module("sounddevice")
    except (ImportError, OSError) as exc:
        pytest.skip(f"needs sounddevice and PortAudio: {exc}")
    with pytest.raises(UsageError, match="no sound from 'no such card'"):
        open_input("no such card", lambda samples, lost: None)


def test_a_device_that_opens_and_does_not_start(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Mock(start=Mock(side_effect=ValueError("Device unavailable")))
    library = Mock(PortAudioError=OSError, InputStream=Mock(return_value=stream))
    library.query_devices.return_value = {"default_samplerate": 48000.0}
    monkeypatch.setitem(sys.modules, "sounddevice", library)
    with pytest.raises(UsageError, match="no sound from 'usb': Device unavailable"):
        open_input("usb", lambda samples, lost: None)
    stream.close.assert_called_once_with()


def test_listening_ends_when_told_to() -> None:
    stop = Event()
    thread = Thread(target=lambda: list(listen("", stop, str, lambda: 7, Card(True).open)))
    thread.start()
    stop.set()
    thread.join(10)
    assert not thread.is_alive()
