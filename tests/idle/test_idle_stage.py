"""The idle stage against the truth of simulated clips, and where there is nothing to find."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from rsenf.bench.tracker.beside import LampRows as Lamp
from rsenf.errors import UsageError
from rsenf.idle import METHODS, IdleSettings, make_idle
from rsenf.messages import Header, IdleEstimate, RowBlock
from rsenf.model import GridPath, Light, Scene, Shake
from rsenf.run.stages import flicker_stages
from rsenf.track import TrackSettings
from tests.idle.idle_clips import camera, error_points, estimates, film, last, std_points

STEADY = Light(daylight_ratio=1.0)


@pytest.mark.parametrize(
    ("frame_rate", "nominal_hz", "seed"),
    [
        ("23.976", 50.0, 1),
        ("24", 50.0, 2),
        ("29.97", 50.0, 3),
        ("30", 50.0, 4),
        ("50", 60.0, 5),
        ("59.94", 50.0, 6),
        ("25", 60.0, 7),
    ],
)
def test_raw_rows_give_idle_to_a_hundredth_of_a_point(
    frame_rate: str, nominal_hz: float, seed: int
) -> None:
    data = film(camera(frame_rate, idle=0.1 + 0.06 * seed), seed, nominal_hz=nominal_hz)
    found = last(data)
    assert found.verdict == "estimated", found.reason
    assert abs(error_points(found, data)) < 0.01
    assert abs(error_points(found, data)) < 5 * std_points(found)
    assert found.nominal_hz == nominal_hz
    assert found.direction == "forward"
    assert found.read_out_time_s == pytest.approx(data.truth["read_out_time_s"], abs=5e-6)
    assert found.idle_ratio_low < found.idle_ratio < found.idle_ratio_high


@pytest.mark.parametrize(
    ("frame_rate", "nominal_hz"), [("25", 50.0), ("50", 50.0), ("30", 60.0), ("29.97", 60.0)]
)
def test_flicker_that_stands_still_gives_idle_to_a_tenth(
    frame_rate: str, nominal_hz: float
) -> None:
    data = film(camera(frame_rate, idle=0.25), 7, nominal_hz=nominal_hz, seconds=60)
    found = last(data)
    assert found.verdict == "estimated", found.reason
    assert abs(error_points(found, data)) < 0.1
    assert found.direction in ("", "forward")
    assert bool(found.direction) != any("assumed" in w for w in found.warnings)


def test_rows_without_the_loop_filter_are_less_sure() -> None:
    data = film(camera("29.97", idle=0.25), 8, nominal_hz=50.0)
    full, fast = last(data), last(data, effort="fast")
    assert fast.idle_ratio == full.idle_ratio
    assert std_points(full) < 0.01
    assert std_points(fast) == pytest.approx(0.1, rel=0.01)


def test_flicker_that_never_turns_is_ambiguous() -> None:
    # Two millihertz off for forty seconds: half a radian.
    grid = GridPath(np.full(50, 50.001), nominal_hz=50.0)
    found = last(film(camera("25"), 3, grid=grid))
    assert found.verdict == "ambiguous"
    assert "radian" in found.reason
    assert np.isnan(found.idle_ratio)


@pytest.mark.parametrize("frame_rate", ["23.976", "29.97"])
def test_read_out_from_the_last_row_is_told(frame_rate: str) -> None:
    data = film(camera(frame_rate).with_effect("reverse_readout"), 4)
    found = last(data)
    assert found.direction == "reverse"
    assert abs(error_points(found, data)) < 0.01


def test_columns_are_rows_of_another_axis() -> None:
    data = film(camera(read_out="columns"), 5)
    found = estimates(data.level, data.frame_time_s, read_out_axis="columns")[-1]
    assert abs(error_points(found, data)) < 0.01


def test_how_rows_come_in_blocks_changes_nothing_that_matters() -> None:
    data = film(camera(), 6)
    some = estimates(data.level, data.frame_time_s, block_frames=8)[-1]
    many = estimates(data.level, data.frame_time_s, block_frames=13)[-1]
    assert many.idle_ratio == pytest.approx(some.idle_ratio, abs=1e-8)
    assert many.idle_ratio_var == pytest.approx(some.idle_ratio_var, rel=1e-2)


def test_estimates_come_in_time_and_sharpen() -> None:
    # Weak light in noise, so that time tells.
    data = film(camera(rows=120, light=Light(lamp="cfl", daylight_ratio=0.7)), 8, seconds=90)
    found = estimates(data.level, data.frame_time_s, every_s=20.0)
    assert [e.header.seq for e in found] == list(range(5))
    claimed = [e for e in found if e.verdict == "estimated"]
    assert len(claimed) >= 3
    assert claimed[-1].idle_ratio_var < 0.7 * claimed[0].idle_ratio_var
    assert found[-1].header.frame_first == 0
    assert found[-1].header.frame_last == len(data.frame_time_s) - 1


def test_standard_error_is_true_for_raw_rows() -> None:
    scores = []
    for seed in range(10):
        data = film(camera("23.976", idle=0.05 + 0.05 * seed, rows=64), seed, seconds=30)
        found = last(data)
        scores.append(error_points(found, data) / std_points(found))
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 1.5


@pytest.mark.parametrize("method", list(METHODS))
@pytest.mark.parametrize("frame_rate", ["25", "29.97"])
@pytest.mark.parametrize("case", ["daylight", "black", "shaken", "whole periods"])
def test_without_light_on_the_mains_nothing_is_claimed(
    method: str, frame_rate: str, case: str
) -> None:
    model = {
        "daylight": camera(frame_rate, light=STEADY),
        "black": camera(frame_rate, light=STEADY, scene=Scene(mean_level=10.0)),
        "shaken": camera(frame_rate, light=STEADY, scene=Scene(shake=Shake())),
        "whole periods": camera(frame_rate).with_effect("exposure", exposure_s=0.01),
    }[case]
    found = last(film(model, 9, seconds=30), method=method)
    assert found.verdict in ("no_signal", "refused")
    assert found.reason
    assert np.isnan(found.idle_ratio)


def test_a_held_camera_that_moves_is_right_or_silent() -> None:
    for seed in range(3):
        data = film(camera("29.97", scene=Scene(shake=Shake(shake_px=2.0))), seed)
        found = last(data)
        assert found.verdict != "estimated" or abs(error_points(found, data)) < 0.1


def test_anti_flicker_exposure_is_named() -> None:
    found = last(film(camera().with_effect("exposure", exposure_s=0.01), 10))
    assert found.verdict == "refused"
    assert "anti-flicker" in found.reason


def test_global_shutter_is_refused() -> None:
    found = last(film(camera(read_out="global"), 11))
    assert found.verdict == "refused"
    assert "global shutter" in found.reason


def test_one_mean_a_frame_is_refused() -> None:
    data = film(camera(), 12, seconds=30)
    mean = data.level.mean(axis=1, keepdims=True)
    found = estimates(mean, data.frame_time_s, read_out_axis="frame")[-1]
    assert found.verdict == "refused"
    assert "rows" in found.reason


def test_grids_that_look_alike_are_ambiguous_until_named() -> None:
    data = film(camera("20", rows=120), 13)
    unnamed = last(data)
    assert unnamed.verdict == "ambiguous"
    assert "nominal" in unnamed.reason
    named = last(data, nominal_hz=50.0)
    assert named.verdict == "estimated"
    assert abs(error_points(named, data)) < 0.1


def test_weighted_predictions_sawtooth_is_refused() -> None:
    data = film(camera(), 14)
    age = np.arange(len(data.frame_time_s)) % 250
    ramp = (0.12 * age).astype(np.float32)[:, None, None]
    found = estimates(data.level + ramp, data.frame_time_s)[-1]
    assert found.verdict == "refused"
    assert "weighted prediction" in found.reason


@pytest.mark.parametrize("lamp", ["led", "ideal", "sodium"])
def test_strong_light_is_no_sawtooth(lamp: str) -> None:
    found = last(film(camera(idle=0.55, light=Light(lamp=lamp)), 15))
    assert found.verdict == "estimated", found.reason


@pytest.mark.parametrize("steady_every", [1000, 16])
def test_unusable_rows_are_left_out_and_named(steady_every: int) -> None:
    """At 25 frames/s too, where flicker may stand still, and few rows seem a short clip."""
    stage = make_idle(IdleSettings())
    for n in range(100):
        stage.update(
            RowBlock(
                frames=8,
                rows=64,
                strips=1,
                frame_number=np.arange(8 * n, 8 * n + 8),
                frame_pts_ns=np.arange(8 * n, 8 * n + 8) * 40_000_000,
                level=np.zeros((8, 64, 1), np.float32),
                kept_px=np.ones((64, 1), np.uint32),
                usable=n % steady_every == 1,
                reason="" if n % steady_every == 1 else "only 3% of the picture is steady",
                header=Header(source="test/cam", seq=n, frame_first=8 * n, frame_last=8 * n + 7),
            )
        )
    found = stage.flush()[-1]
    assert found.verdict == "no_signal"
    assert found.reason == "only 3% of the picture is steady"


def test_a_short_clip_says_so() -> None:
    found = last(film(camera(), 16, seconds=2))
    assert found.verdict == "no_signal"
    assert found.reason


def test_nothing_in_nothing_out() -> None:
    assert make_idle(IdleSettings()).flush() == []


def test_unknown_method_and_settings_are_usage_errors() -> None:
    with pytest.raises(UsageError, match="no idle method"):
        make_idle(IdleSettings(method="guess"))
    with pytest.raises(UsageError):
        IdleSettings(nominal_hz=55.0)
    with pytest.raises(UsageError):
        IdleSettings(every_s=0.0)


def test_rows_of_flicker_that_moves_are_not_kept() -> None:
    track, idle = (stage.make() for stage in flicker_stages(TrackSettings(), IdleSettings()))
    tracemalloc.start()
    try:
        found: list[IdleEstimate] = []
        for block in Lamp(1080, 30.0, 8).blocks(0.0, 50.0):
            track.update(block)
            found += idle.update(block)
        held_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found[-1].verdict == "estimated"
    assert held_bytes < 10e6  # 15 to 19 s of rows, which wait for their phase, are 5 MB of it
