from __future__ import annotations

import math

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.model.analytic import COSINE, RECTIFIED, SpectralLine, branch_gain, lines
from rsenf.model.analytic_tables import PRINTED_TIE, strongest


def near(found: tuple[SpectralLine, ...], freq_hz: float) -> SpectralLine:
    return min(found, key=lambda line: abs(line.freq_hz - freq_hz))


@pytest.mark.parametrize("capacity", [12, 17, 19.37, 240.0])
@pytest.mark.parametrize("m", [-3, 0, 1, 5])
def test_eq_7_is_the_sum_that_defines_it(capacity: float, m: int) -> None:
    rows, omega = 12, np.array([-3.0, -0.4, 0.0, 0.1, 1.0, 2.9])
    row = np.arange(rows)
    slow = [
        sum(np.exp(-1j * (w * (capacity - rows) + 2 * np.pi * m) / capacity * row)) / capacity
        for w in omega
    ]
    assert branch_gain(omega, m, rows, capacity) == pytest.approx(np.array(slow), abs=1e-12)


def test_eq_6_is_the_spectrum_of_the_rows_that_are_left() -> None:
    rows, capacity, frames = 5, 8, 6
    light = np.random.default_rng(1).standard_normal(frames * capacity)
    left = light.reshape(frames, capacity)[:, :rows].ravel()

    def spectrum(series: np.ndarray, omega: np.ndarray) -> np.ndarray:
        return np.exp(-1j * omega[..., None] * np.arange(series.size)) @ series

    omega = np.linspace(-3.1, 3.1, 23)
    m = np.arange(capacity)
    copies = spectrum(light, (omega[:, None] * rows - 2 * np.pi * m) / capacity)
    got = (copies * branch_gain(omega[:, None], m, rows, capacity)).sum(axis=1)
    assert got == pytest.approx(spectrum(left, omega), abs=1e-10)


@pytest.mark.parametrize("idle_ratio", [0.0, 0.05, 0.237, 0.5, 0.81, 0.95])
@pytest.mark.parametrize("rows", [32, 33, 720])
def test_amplitudes_at_finite_l_and_for_many_rows(idle_ratio: float, rows: int) -> None:
    frame_rate_hz, f0_hz = 29.97, 100.0
    c = f0_hz * idle_ratio / frame_rate_hz
    found = lines(frame_rate_hz, f0_hz, idle_ratio, rows=rows)
    for m in range(-5, 9):
        size = near(found, abs(f0_hz - m * frame_rate_hz)).amplitude
        slow = abs(np.mean(np.exp(2j * np.pi * np.arange(rows) * (m - c) / rows)))
        assert size == pytest.approx(slow, abs=1e-9)
        assert size == pytest.approx(abs(np.sinc(c - m)), abs=15 / rows**2 + 1e-9)


def test_the_lines_hold_all_of_the_light_s_power() -> None:
    # 97 rows and this rate: no line at 0 Hz, at the Nyquist frequency, or on another.
    for idle_ratio in (0.0, 0.3, 0.77):
        found = lines(23.976, 100.0, idle_ratio, rows=97, harmonics=(1.0, -0.2))
        assert len(found) == 2 * 97
        assert all(0 < line.freq_hz < 23.976 * 97 / 2 for line in found)
        assert sum(line.amplitude**2 for line in found) == pytest.approx(1.04)


def test_eqs_12_and_19_and_the_bound_that_drops_folded_lines() -> None:
    paper = lines(30.0, 100.0, 0.4, folded=False, top_hz=250.0)
    assert sorted(round(line.freq_hz) for line in paper) == [10, 40, 70, 100, 130, 160, 190, 220]
    whole = lines(30.0, 100.0, 0.4, top_hz=250.0)
    folded = {20, 50, 80, 110, 140, 170, 200, 230}
    assert {round(line.freq_hz) for line in whole} == folded | {
        round(line.freq_hz) for line in paper
    }
    assert {(near(whole, hz).m, near(whole, hz).freq_hz) for hz in (20, 50)} == {(4, 20), (5, 50)}
    # Strongest first, and the same line has the same amplitude in both.
    assert [x.amplitude for x in whole] == sorted((x.amplitude for x in whole), reverse=True)
    assert near(whole, 70).amplitude == near(paper, 70).amplitude


@pytest.mark.parametrize("idle_ratio", [0.05, 0.2, 0.33, 0.6, 0.8, 0.95])
def test_lines_of_a_cosine_at_25_fps_against_their_closed_form(idle_ratio: float) -> None:
    # Many rows: sin(πc)/π · (e^{jψ}/(d + q) + e^{−jψ}/(d − q)) with d = c − 4, at q·F_r; ψ is the
    # light's phase in the middle of the idle period before a frame.
    c = 4 * idle_ratio
    d = c - 4
    found = lines(25.0, 100.0, idle_ratio, rows=20_000, top_hz=300.0)
    assert all(round(line.freq_hz) % 25 == 0 for line in found)
    for q in range(1, 7):
        line = near(found, 25.0 * q)
        for phase_rad in (0.0, 0.7, 2.5):
            psi = phase_rad - np.pi * c
            slow = np.exp(1j * psi) / (d + q) + np.exp(-1j * psi) / (d - q)
            slow *= np.sin(np.pi * c) / np.pi
            assert line.at_phase(phase_rad) == pytest.approx(abs(slow), abs=2e-3)
        low, high = line.amplitude_range()
        sizes = abs(np.sin(np.pi * c) / np.pi) * np.abs([1 / (d + q), 1 / (d - q)])
        assert low == pytest.approx(abs(sizes[0] - sizes[1]), abs=1e-3)
        assert high == pytest.approx(sizes.sum(), abs=1e-3)
        assert line.amplitude == pytest.approx(math.hypot(*sizes), abs=1e-3)
        assert line.amplitude**2 == pytest.approx(
            np.mean(line.at_phase(np.arange(360) * np.pi / 180) ** 2)
        )


@pytest.mark.parametrize(("frame_rate_hz", "f0_hz"), [(25.0, 100.0), (30.0, 120.0), (30.0, 100.0)])
@pytest.mark.parametrize("idle_ratio", [0.1, 0.38, 0.9])
@pytest.mark.parametrize("exposure_s", [0.0, 0.003])
def test_every_line_at_a_phase_against_a_slow_sum(
    frame_rate_hz: float, f0_hz: float, idle_ratio: float, exposure_s: float
) -> None:
    # Three frames bring every line of these rates to a whole number of turns.
    rows, frames, phase_rad, harmonics = 40, 3, 1.1, (1.0, -0.2 + 0.1j, 0.0857)
    n, row = np.mgrid[:frames, :rows]
    t_s = n / frame_rate_hz + row * (1 - idle_ratio) / frame_rate_hz / rows
    steps_s = (np.arange(2000) + 0.5) / 2000 * exposure_s
    series = np.zeros(frames * rows)
    for k, size in enumerate(harmonics, 1):
        turn = k * (2 * np.pi * f0_hz * (t_s.ravel()[:, None] + steps_s) + phase_rad)
        series += np.mean(np.real(size * np.exp(1j * turn)), axis=1)
    found = lines(
        frame_rate_hz, f0_hz, idle_ratio, rows=rows, harmonics=harmonics, exposure_s=exposure_s
    )
    assert len(found) >= 19
    index = np.arange(series.size) / (frame_rate_hz * rows)
    for line in found:
        slow = 2 * abs(np.mean(series * np.exp(-2j * np.pi * line.freq_hz * index)))
        assert line.at_phase(phase_rad) == pytest.approx(slow, abs=1e-6)


def test_exposure_takes_its_sinc_of_each_harmonic() -> None:
    kwargs = {"harmonics": RECTIFIED[:3], "top_hz": 400.0}
    sharp, blurred = (lines(29.97, 100.0, 0.2, exposure_s=t, **kwargs) for t in (0.0, 1 / 250))
    for line in sharp:
        expected = line.amplitude * abs(np.sinc(line.harmonic * 100 / 250))
        assert near(blurred, line.freq_hz).amplitude == pytest.approx(expected)
    ratio = [strongest(found).amplitude_ratio for found in (sharp, blurred)]
    assert ratio[0] == pytest.approx(ratio[1])
    half = lines(29.97, 100.0, 0.2, exposure_s=1 / 200, **kwargs)
    assert max(line.amplitude for line in half if line.harmonic == 2) < 1e-15
    assert near(half, 100.0).amplitude == pytest.approx(near(sharp, 100.0).amplitude * 2 / np.pi)
    assert max(x.amplitude for x in lines(29.97, 100.0, 0.2, exposure_s=0.01, **kwargs)) < 1e-15


def test_the_rectified_cosine_s_harmonics() -> None:
    wave = np.abs(np.cos(np.arange(4096) * np.pi / 4096))
    fourier = np.fft.rfft(wave).real
    assert fourier[1:9] / fourier[1] == pytest.approx(RECTIFIED, rel=1e-4)
    assert RECTIFIED[:3] == pytest.approx((1, -1 / 5, 3 / 35))
    assert COSINE == (1.0,)


def test_strongest_two_ties_and_nothing_second() -> None:
    plain = strongest(lines(30.0, 100.0, 0.05))
    assert [x.freq_hz for x in (*plain.first, *plain.second)] == pytest.approx([100, 70])
    assert plain.amplitude_ratio == pytest.approx(5.0, rel=1e-4)
    assert plain.ratio_range is None
    tied = strongest(lines(30.0, 100.0, 0.15))
    assert tied.first == tied.second
    assert [x.freq_hz for x in tied.first] == pytest.approx([100, 70])
    assert tied.amplitude_ratio == pytest.approx(1.0)
    alone = strongest(lines(30.0, 100.0, 0.0))
    assert (alone.second, alone.amplitude_ratio, alone.ratio_range) == ((), None, None)
    close = lines(29.97, 100.0, 0.3)
    assert [x.freq_hz for x in strongest(close).second] == pytest.approx([40.06])
    printed = strongest(close, PRINTED_TIE).second
    assert [x.freq_hz for x in printed] == pytest.approx([100, 40.06])


def test_the_ratio_s_range_over_the_light_s_phase() -> None:
    # Known: 3.5 to 4.6 at 20 %, 2.1 to 4.1 at 95 %; from the closed form at ψ = 90° and 0°.
    for idle_ratio, low, high in ((0.2, 3.484, 4.645), (0.95, 2.0625, 4.125)):
        spread = strongest(lines(25.0, 100.0, idle_ratio)).ratio_range
        assert spread == pytest.approx((low, high), abs=1e-3)


@pytest.mark.parametrize(
    "arguments",
    [(0.0, 100.0, 0.1), (30.0, -1.0, 0.1), (30.0, 100.0, 1.0), (30.0, 100.0, -0.1),
     (30.0, 100.0, math.nan), (math.nan, 100.0, 0.1)],
)  # fmt: skip
def test_captures_that_can_t_be(arguments: tuple[float, float, float]) -> None:
    with pytest.raises(UsageError):
        lines(*arguments)


def test_no_line_to_pick_from() -> None:
    with pytest.raises(UsageError, match="no line"):
        strongest(lines(30.0, 100.0, 0.1, top_hz=5.0))
