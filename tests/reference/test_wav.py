"""Recordings of the mains, with a known frequency."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.errors import ReferenceFormatError
from rsenf.reference import read_reference
from tests.reference.reference_files import T0_NS, write_wav


def mains(freq_hz, rate_hz, *, harmonic=1, amplitude=0.5, noise=0.0, seed=0):
    """A tone whose frequency is constant within each second, and its odd harmonics."""
    per_sample = np.repeat(freq_hz, rate_hz)
    phase = 2 * np.pi * harmonic * np.cumsum(per_sample) / rate_hz
    rng = np.random.default_rng(seed)
    tone = np.cos(phase) + 0.1 * np.cos(3 * phase + 1) + 0.05 * np.cos(5 * phase)
    return amplitude * tone + noise * rng.standard_normal(phase.size)


def path_hz(seconds, nominal_hz=50.0, seed=3):
    rng = np.random.default_rng(seed)
    return nominal_hz + 0.02 * np.cumsum(rng.standard_normal(seconds)) / 10


@pytest.mark.parametrize(
    ("rate_hz", "layout"),
    [
        (8000, {"bits": 16}),
        (400, {"bits": 16}),
        (1000, {"bits": 24, "extensible": True}),
        (1000, {"bits": 32, "channels": 2}),
        (1000, {"is_float": True}),
        (11025, {"bits": 8}),
    ],
)
def test_frequency_comes_back(tmp_path, rate_hz, layout):
    truth = path_hz(130)
    path = write_wav(tmp_path / "mains.wav", mains(truth, rate_hz), rate_hz, **layout)
    reference = read_reference(path)
    assert (reference.nominal_hz, reference.step_s, reference.t0_ns) == (50.0, 1.0, 0)
    assert reference.freq_hz.size == 130
    tolerance_hz = 1e-3 if layout.get("bits") == 8 else 2e-4
    np.testing.assert_allclose(reference.freq_hz, truth, atol=tolerance_hz)


def test_sixty_hertz_and_second_harmonic(tmp_path):
    truth = path_hz(60, 60.0)
    path = write_wav(tmp_path / "us.wav", mains(truth, 1000), 1000)
    assert read_reference(path).nominal_hz == 60.0
    hum = write_wav(tmp_path / "hum.wav", mains(truth, 1000, harmonic=2), 1000)
    reference = read_reference(hum)
    np.testing.assert_allclose(reference.freq_hz, truth, atol=2e-4)
    assert any("second harmonic of 60 Hz" in note for note in reference.notes)


def test_seconds_without_a_tone_are_gaps(tmp_path):
    truth = path_hz(100)
    signal = mains(truth, 1000, noise=1e-3)
    signal[40_000:50_000] = 0.05 * np.random.default_rng(1).standard_normal(10_000)
    path = write_wav(tmp_path / "mains.wav", signal, 1000)
    reference = read_reference(path)
    assert np.isnan(reference.freq_hz[40:50]).all()
    assert np.isfinite(np.delete(reference.freq_hz, np.arange(40, 50))).all()
    assert (reference.readings == np.isfinite(reference.freq_hz)).all()
    assert any("without a clear tone, taken as gaps: 10" in note for note in reference.notes)


def test_a_start_can_be_given(tmp_path):
    path = write_wav(tmp_path / "mains.wav", mains(path_hz(30), 1000), 1000)
    assert read_reference(path, start_utc_ns=T0_NS).t0_ns == T0_NS


def test_a_recording_cut_off_is_read_as_far_as_it_goes(tmp_path):
    truth = path_hz(100)
    path = write_wav(tmp_path / "mains.wav", mains(truth, 1000), 1000)
    path.write_bytes(path.read_bytes()[:-60_001])
    reference = read_reference(path)
    assert reference.freq_hz.size == 69
    np.testing.assert_allclose(reference.freq_hz, truth[:69], atol=2e-4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"time,frequency\n1,50\n", "no WAV file"),
        (b"RIFF\0\0\0\0WAVE", "no samples"),
        (b"RIFF\0\0\0\0WAVEfmt \x04\0\0\0abcd", "cut off"),
        (b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\x02\0\x01\0\0\x10\0\0\0\0\0\0\0\0\x04\0", "coding 2"),
    ],
)
def test_what_is_no_wav(tmp_path, content, message):
    path = tmp_path / "x.wav"
    path.write_bytes(content)
    with pytest.raises(ReferenceFormatError, match=message):
        read_reference(path)


def test_recordings_without_mains_or_too_short(tmp_path):
    noise = 0.1 * np.random.default_rng(0).standard_normal(20_000)
    with pytest.raises(ReferenceFormatError, match="no mains tone"):
        read_reference(write_wav(tmp_path / "noise.wav", noise, 1000))
    with pytest.raises(ReferenceFormatError, match=r"1\.5 s at 1000 Hz"):
        read_reference(write_wav(tmp_path / "short.wav", noise[:1500], 1000))
    with pytest.raises(ReferenceFormatError, match="100 Hz"):
        read_reference(write_wav(tmp_path / "slow.wav", noise, 100))


@pytest.mark.measured
def test_measured_mains_agree_with_somebody_else_s_demodulation(measured_data):
    mine = read_reference(measured_data / "whu_audio" / "001_mains_reference_400hz.wav")
    theirs = read_reference(measured_data / "whu_reference_1s" / "whu_001_ref_1s.csv", step_s=1)
    both = min(mine.freq_hz.size, theirs.freq_hz.size)
    difference_hz = mine.freq_hz[5 : both - 5] - theirs.freq_hz[5 : both - 5]
    assert np.std(difference_hz) < 0.3e-3
    assert abs(difference_hz.mean()) < 0.05e-3
