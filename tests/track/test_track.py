"""The ENF estimator against a slow least-squares search, against truth, and against no signal."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.lines import Line, candidate_lines, project, templates
from rsenf.flicker.tone import ToneFinder
from rsenf.messages import EnfEstimate, Header, RowBlock, canonical
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import METHODS, TrackSettings, make_tracker
from rsenf.track.stft import SMEAR_STD_HZ
from tests.oracle.tone_search import tone_frequency

RATE_HZ = 30000 / 1001


def rows_of(
    enf_hz: float,
    *,
    seconds: float = 30.0,
    rows: int = 60,
    idle: float = 0.38,
    depth: float = 5.0,
    noise: float = 0.3,
    seed: int = 0,
    times: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Row means under a flickering lamp of constant frequency, with texture and noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ if times is None else times
    read_out_s = (1 - idle) / RATE_HZ
    at = t[:, None] + np.arange(rows) / rows * read_out_s
    texture = rng.uniform(80, 140, rows)
    level = texture + depth * np.cos(2 * np.pi * 2 * enf_hz * at + 0.7)
    return (level + rng.normal(0, noise, level.shape)).astype(np.float32), t


def track(
    level: NDArray[np.float32], t: NDArray[np.float64], **settings: object
) -> list[EnfEstimate]:
    settings = {"method": "stft"} | settings
    stage = make_tracker(TrackSettings(**settings))  # type: ignore[arg-type]  # checked inside
    blocks = blocks_from_luminance(level[:, :, None], t, Header(source="t/c"))
    return list(itertools.chain.from_iterable(map(stage.update, blocks))) + stage.flush()


def noise_std_hz(estimate: EnfEstimate) -> float:
    """Return the part of the standard error that is noise, not smearing."""
    return float(np.sqrt(estimate.enf_var_hz2 - SMEAR_STD_HZ**2))


@pytest.mark.parametrize("nominal", [50.0, 60.0])
@pytest.mark.parametrize("deviation", [0.038, 0.0, 0.021])
def test_constant_frequency_is_found_to_a_tenth_of_a_millihertz(
    nominal: float, deviation: float
) -> None:
    estimates = track(*rows_of(nominal + deviation), nominal_hz=nominal)
    assert len(estimates) == 11
    for estimate in estimates:
        assert estimate.usable
        assert abs(estimate.enf_hz - nominal - deviation) < max(1e-4, 4 * noise_std_hz(estimate))
        assert estimate.enf_var_hz2 > 0


def test_values_come_one_a_second_from_the_tenth() -> None:
    estimates = track(*rows_of(50.02))
    assert [round(e.t_s, 6) for e in estimates] == [10.0 + k for k in range(11)]
    assert [e.header.seq for e in estimates] == list(range(11))
    assert all(e.end_pts_ns - e.start_pts_ns == 20 * 10**9 for e in estimates)
    assert [e.header.frame_first for e in estimates][:3] == [0, 30, 60]
    assert [e.header.frame_last for e in estimates][:3] == [599, 629, 659]


def test_nominal_frequency_is_found() -> None:
    assert {e.nominal_hz for e in track(*rows_of(49.95))} == {50.0}
    assert {e.nominal_hz for e in track(*rows_of(60.03))} == {60.0}


@pytest.mark.parametrize("seed", range(6))
def test_slow_drift_is_not_taken_for_the_other_grid(seed: int) -> None:
    """At 29.97 fps, 120 Hz shows at 0.12 Hz, where codecs and clouds drift."""
    rng = np.random.default_rng(seed)
    level, t = rows_of(49.97, depth=0.1, noise=1.0, seed=seed)
    down = np.cos(2 * np.pi * 2 * np.arange(level.shape[1]) / level.shape[1])
    drift = np.cumsum(rng.normal(0, 1.0, t.size))
    drift -= np.linspace(0, drift[-1], t.size)
    level = (level + drift[:, None] * (1 + 0.3 * down)).astype(np.float32)
    assert not any(e.usable and e.nominal_hz == 60.0 for e in track(level, t))


@pytest.mark.parametrize(("nominal", "rate_hz"), [(60.0, RATE_HZ), (60.0, 30.0), (50.0, 25.0)])
@pytest.mark.parametrize("deviation", [-0.1, -0.04, 0.03, 0.07])
def test_flicker_near_0_hz_is_right_or_not_used(
    nominal: float, rate_hz: float, deviation: float
) -> None:
    t = np.arange(int(24 * rate_hz)) / rate_hz
    level, t = rows_of(nominal + deviation, times=t, noise=1.0)
    for e in track(level, t, nominal_hz=nominal):
        assert not e.usable or abs(e.enf_hz - nominal - deviation) < 2e-3


def test_line_that_the_idle_period_makes_strongest_is_followed() -> None:
    # Paper, table for 29.97 fps: at idle 0 the strongest line is 100 Hz, at 40 % it is 70 Hz, at
    # 55 % 40 Hz, at 85 % 10 Hz.
    for idle, line_hz in ((0.02, 100.0), (0.40, 70.0), (0.55, 40.0), (0.85, 10.0)):
        estimates = track(*rows_of(50.0, idle=idle), nominal_hz=50.0)
        assert {round(e.line_hz) for e in estimates} == {line_hz}


def test_window_equals_slow_search() -> None:
    finder = ToneFinder(20.0, 0.5)
    rng = np.random.default_rng(4)
    t = np.sort(rng.uniform(-10, 10, 500))  # any times, not a uniform grid
    for offset, constant in ((0.0173, 0.0), (-0.211, 30.0), (0.093, 400.0j)):
        carrier_hz = 100.0
        series = constant + 2.0 * np.exp(2j * np.pi * (carrier_hz + offset) * t)
        series = series + rng.normal(0, 0.5, t.size) + 1j * rng.normal(0, 0.5, t.size)
        carrier = np.exp(-2j * np.pi * carrier_hz * t)
        _, power = finder.periodograms((series * carrier)[:, None], carrier, t)
        tone = finder.strongest(power[:, 0], t)
        slow = tone_frequency(series, t, carrier_hz + round(offset, 1), 20.0) - carrier_hz
        assert abs(tone.offset_hz - slow) < 4e-4
        assert abs(tone.amplitude - 2.0) < 0.2


def test_projection_is_the_line_of_the_concatenated_series() -> None:
    """Summing row profiles frame by frame equals a DFT of the concatenated rows at that line."""
    level, t = rows_of(50.03, seconds=4.0, rows=24, noise=0.0)
    frames, rows = level.shape
    (block,) = blocks_from_luminance(level[:, :, None], t, Header(), block_frames=frames)
    line = Line(50.0, 1, -1)
    fast = project(block, templates((line,), RATE_HZ, rows, 1.0))[:, 0]
    line_hz = 100.0 - RATE_HZ
    i = np.arange(frames * rows) + 0.5
    turn = np.exp(-2j * np.pi * line_hz * i / (RATE_HZ * rows))
    slow = np.sum(level.reshape(-1) * turn)
    frame_turn = np.exp(-2j * np.pi * line_hz * np.arange(frames) / RATE_HZ)
    assert abs(np.sum(fast * frame_turn) * rows - slow) < 1e-6 * abs(slow)


def test_candidate_lines_are_the_papers() -> None:
    lines = candidate_lines(50.0, 1, RATE_HZ, rows=720)
    assert sorted(round(x.line_hz(RATE_HZ)) for x in lines) == [10, 40, 70, 100, 130, 160, 190]
    lines = candidate_lines(50.0, 1, 25.0, rows=720)
    assert sorted(round(x.line_hz(25.0)) for x in lines) == [25, 50, 75, 100, 125, 150, 175, 200]
    assert candidate_lines(50.0, 1, RATE_HZ, rows=1) == (Line(50.0, 1, 0),)


def test_stated_errors_are_true_for_noise() -> None:
    """Errors over the noise part of the standard error have a standard deviation near 1."""
    scaled = []
    for seed in range(120):
        (e,) = track(*rows_of(50.01, seconds=20.4, rows=8, depth=3.0, noise=4.0, seed=seed))
        assert e.usable
        scaled.append((e.enf_hz - 50.01) / noise_std_hz(e))
    # 120 values: the standard deviation of their standard deviation is 0.065.
    assert 0.8 < np.std(scaled) < 1.25
    assert abs(np.mean(scaled)) < 0.35


def test_streaming_equals_batch_bit_for_bit() -> None:
    level, t = rows_of(50.02, seconds=26.0)
    blocks = list(blocks_from_luminance(level[:, :, None], t, Header(source="t/c")))
    stage = make_tracker(TrackSettings(method="stft"))
    streamed = [canonical(e) for b in blocks for e in stage.update(b)]
    streamed += [canonical(e) for e in stage.flush()]
    assert streamed == [canonical(e) for e in track(level, t)]
    assert len(streamed) == 7


def test_variable_frame_times_do_not_matter() -> None:
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.02, 0.05, 900))
    times -= times[0]
    estimates = track(*rows_of(50.04, times=times, idle=0.0), nominal_hz=50.0, line_m=0)
    assert len(estimates) >= 10
    assert max(abs(e.enf_hz - 50.04) for e in estimates) < 1e-3


def test_memory_is_bounded() -> None:
    stage = METHODS.find("stft")(TrackSettings(method="stft"))
    level, t = rows_of(50.0, seconds=200.0, rows=4)
    for block in blocks_from_luminance(level[:, :, None], t, Header()):
        stage.update(block)
    assert stage._buffer._value.shape[0] <= 4096  # type: ignore[attr-defined]  # the storage itself


def test_no_light_is_a_result() -> None:
    rng = np.random.default_rng(9)
    t = np.arange(900) / RATE_HZ
    for level in (
        np.full((900, 40), 16.0),  # black
        100 + rng.normal(0, 1, (900, 40)),  # daylight
        100 + 5 * np.cumsum(rng.normal(0, 0.05, (900, 1)), axis=0) + np.zeros((1, 40)),  # clouds
    ):
        estimates = track(level.astype(np.float32), t)
        assert estimates
        for estimate in estimates:
            assert not estimate.usable
            assert estimate.reason
            assert np.isnan(estimate.enf_hz)


def test_false_signals_are_rare() -> None:
    """Noise alone, 200 clips: none may be called ENF."""
    claimed = 0
    for seed in range(200):
        rng = np.random.default_rng(1000 + seed)
        level = (100 + rng.normal(0, 1, (610, 8))).astype(np.float32)
        claimed += sum(e.usable for e in track(level, np.arange(610) / RATE_HZ))
    assert claimed == 0


def test_alias_on_top_of_the_texture_costs_certainty_not_truth() -> None:
    """25 fps under 50 Hz: the flicker stands still when the grid is at its nominal frequency."""
    t = np.arange(750) / 25.0
    off = track(*rows_of(50.06, times=t), nominal_hz=50.0)
    assert all(abs(e.enf_hz - 50.06) < 2e-3 for e in off if e.usable)
    on = track(*rows_of(50.0, times=t), nominal_hz=50.0)
    assert not any(e.usable and abs(e.enf_hz - 50.0) > 0.01 for e in on)


def test_frames_missing_from_a_window_make_it_unusable() -> None:
    level, t = rows_of(50.0, seconds=60.0)
    keep = (t < 25) | (t > 33)
    estimates = track(level[keep], t[keep], nominal_hz=50.0)
    hole = [e for e in estimates if e.start_pts_ns / 1e9 < 29 < e.end_pts_ns / 1e9]
    assert any(not e.usable and "frames are there" in e.reason for e in hole)
    assert all(abs(e.enf_hz - 50.0) < 1e-3 for e in estimates if e.usable)


def test_rows_that_are_not_usable_make_no_estimate() -> None:
    import dataclasses

    level, t = rows_of(50.0)
    stage = make_tracker(TrackSettings(method="stft"))
    blocks = blocks_from_luminance(level[:, :, None], t, Header())
    bad = (dataclasses.replace(b, usable=False, reason="moving") for b in blocks)
    estimates = [e for b in bad for e in stage.update(b)]
    assert estimates
    assert not any(e.usable for e in estimates)


def test_amplitude_follows_the_phase_of_the_light() -> None:
    deviation_hz = 0.03
    estimates = track(*rows_of(50.0 + deviation_hz, noise=0.05), nominal_hz=50.0)
    phase = np.unwrap([np.angle(complex(e.amplitude_re[0], e.amplitude_im[0])) for e in estimates])
    t = np.array([e.amplitude_pts_ns[0] for e in estimates]) / 1e9
    slope_hz = np.polyfit(t, phase, 1)[0] / (2 * np.pi)
    assert abs(slope_hz - 2 * deviation_hz) < 1e-4
    assert {e.carrier_hz for e in estimates} == {100.0}


def test_empty_and_short_streams() -> None:
    assert make_tracker(TrackSettings(method="stft")).flush() == []
    level, t = rows_of(50.0, seconds=0.34)
    assert track(level, t) == []
    assert make_tracker(TrackSettings(method="stft")).update(RowBlock(header=Header())) == []


def test_settings_that_can_not_be_meant() -> None:
    with pytest.raises(UsageError, match="no line 99"):
        track(*rows_of(50.0, seconds=3.0), line_m=99)
    with pytest.raises(UsageError, match="55"):
        TrackSettings(nominal_hz=55.0)
    with pytest.raises(UsageError, match="no ENF method"):
        make_tracker(TrackSettings(method="magic"))
