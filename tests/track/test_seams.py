"""Seconds whose frame rate may be another, 0.1 % off: what waits, what is said, and what isn't."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.flicker.conversions import SEAMS, SeamWatch
from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.second import FlickerSecond

NTSC_HZ = 30e3 / 1001


def seconds(
    count: int,
    f0_hz: float,
    rate_hz: float = 30.0,
    slips: dict[int, int] | None = None,
    nominal_hz: float = 50.0,
) -> list[FlickerSecond]:
    """Seconds of light of a frequency at a rate; ``slips`` has frames lost, by second."""
    frames = round(rate_hz)
    return [
        FlickerSecond(
            index=k, start_s=float(k), end_s=k + 1.0, usable=True, nominal_hz=nominal_hz,
            frame_rate_hz=rate_hz, f0_hz=f0_hz, snr_db=50.0,
            slips=(FrameSlip(k * frames + 7, slips[k]),) if slips and k in slips else (),
            frame_number=np.arange(k * frames, (k + 1) * frames),
        )
        for k in range(count)
    ]  # fmt: skip


def said(of: list[FlickerSecond]) -> list[FlickerSecond]:
    watch = SeamWatch()
    return watch.update(of) + watch.flush()


@pytest.mark.parametrize(("rate_hz", "f0_hz"), [(30.0, 100.1), (NTSC_HZ, 99.9)])
def test_a_grid_0_1_percent_off_is_not_claimed_within_a_beat(rate_hz: float, f0_hz: float) -> None:
    out = said(seconds(30, f0_hz, rate_hz))
    assert [s.index for s in out] == list(range(30))
    assert not any(s.usable for s in out)
    assert {s.reason for s in out} == {SEAMS}


@pytest.mark.parametrize(("rate_hz", "f0_hz"), [(30.0, 99.9), (NTSC_HZ, 100.1), (30.01, 100.1)])
def test_off_the_other_way_or_at_another_rate_it_is(rate_hz: float, f0_hz: float) -> None:
    assert all(s.usable for s in said(seconds(30, f0_hz, rate_hz)))


def test_a_beat_without_a_seam_clears_all_of_it() -> None:
    watch = SeamWatch()
    of = seconds(40, 100.1)
    assert watch.update(of[:30]) == []
    out = watch.update(of[30:])
    assert [s.index for s in out] == list(range(40))
    assert all(s.usable for s in out)


def test_a_seam_a_beat_is_never_cleared_and_seconds_wait_a_minute_at_most() -> None:
    watch = SeamWatch()
    out = watch.update(seconds(100, 100.1, slips={20: -1, 53: -1, 86: -1}))
    assert [s.index for s in out] == list(range(40))
    assert not any(s.usable for s in out + watch.flush())


def test_where_a_frame_slips_like_a_seam_a_usual_frequency_has_to_be_sure() -> None:
    assert [s.usable for s in said(seconds(30, 100.0, slips={20: -1}))] == [True] * 20 + [
        False
    ] * 10
    assert all(s.usable for s in said(seconds(30, 99.7, slips={20: -1})))
    assert all(s.usable for s in said(seconds(30, 100.0, slips={20: 1}, rate_hz=25.0)))


def test_where_no_slip_would_be_seen_nothing_waits_and_nothing_clears() -> None:
    def standing(f0_hz: float) -> list[FlickerSecond]:
        return [dataclasses.replace(s, nominal_hz=60.0) for s in seconds(60, f0_hz, NTSC_HZ)]

    watch = SeamWatch()
    out = watch.update(standing(119.88))
    assert len(out) == 60
    assert not any(s.usable for s in out)
    assert all(s.usable for s in SeamWatch().update(standing(120.0)))


def test_pictures_shown_twice_tell_where_light_does_not() -> None:
    of = [
        dataclasses.replace(s, nominal_hz=60.0, doubled=(k * 30 + 7,) if k == 20 else ())
        for k, s in enumerate(seconds(30, 120.0))
    ]
    assert not any(s.usable for s in said(of)[20:])
    assert all(s.usable for s in said([dataclasses.replace(s, doubled=()) for s in of]))


def test_frames_that_slip_within_a_beat_are_no_seams() -> None:
    assert all(s.usable for s in said(seconds(30, 100.0, slips={5: -1, 20: -1})))
    assert not any(s.usable for s in said(seconds(60, 100.1, slips={5: -1, 38: -1})))


def test_a_picture_shown_twice_is_no_frame_lost() -> None:
    of = seconds(30, 100.0, NTSC_HZ, slips={20: 1})
    assert not any(s.usable for s in said(of)[20:])
    of[21] = dataclasses.replace(of[21], doubled=(20 * 30 + 7,))
    assert all(s.usable for s in said(of))


def test_slips_half_a_beat_apart_are_seams_too() -> None:
    """60 frames/s shown at 29.97: one more is left out each 500.5 that are shown."""
    made = [
        dataclasses.replace(s, slips=tuple(FrameSlip(n, 1) for n in slips if n in s.frame_number))
        for slips in [(10, 510, 1011, 1511)]
        for s in seconds(60, 99.95, NTSC_HZ)
    ]
    assert not any(s.usable for s in said(made))


def test_pictures_that_are_all_new_do_not_rule_out_twice_the_rate() -> None:
    made = [
        dataclasses.replace(s, doubled=(), snr_db=20.0) for s in seconds(60, 120.146, nominal_hz=60)
    ]
    assert not any(s.usable for s in said(made))
