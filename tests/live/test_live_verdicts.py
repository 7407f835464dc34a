"""Verdicts on feeds that are live, and on those that only look like it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from live_feeds import (
    AHEAD_S,
    GRID_S,
    NS,
    RATE,
    START_S,
    T0_NS,
    Camera,
    Said,
    looped,
    reference,
    said,
)

from rsenf.errors import UsageError
from rsenf.live import Limits, Live, LiveSettings, Silence
from rsenf.messages import Alarm, EnfEstimate, Header, ReferenceBlock, RowBlock, canonical


@pytest.mark.parametrize("clock_ppm", [-90.0, 0.0, 70.0])
def test_an_honest_feed_is_live_with_its_lag_and_its_clock(clock_ppm: float) -> None:
    told = said([reference(), *Camera(clock_ppm=clock_ppm, late_s=1.3).messages(240)])
    assert told.story == ["undecided", "live"]
    assert told.alarms == []
    assert told.first("live").header.pts_ns < 90 * NS
    end = told.verdicts[-1]
    assert abs(end.clock_ppm - clock_ppm) < 4 * end.clock_std_ppm < 8
    assert abs(end.lag_s - 1.3) < 4 * end.lag_std_s < 2
    assert end.since_ns == told.first("live").since_ns
    assert end.log10_lr > 10
    assert len(told.verdicts) == 241  # one a second, and one at the end


def test_a_loop_is_stale_and_its_past_is_found() -> None:
    """Coded anew, so that no picture is to the last bit as it was."""
    camera = Camera(filmed=looped(160, 100))
    told = said([reference(), *camera.messages(300)])
    assert told.story == ["undecided", "live", "stale"]
    assert told.first("stale").header.pts_ns < (160 + AHEAD_S + 75) * NS
    found = next(v for v in told.verdicts if v.origin_utc_ns)
    assert found.lag_s == pytest.approx(100.3, abs=0.5)  # in the first round
    (loop,) = told.alarms_of("loop")
    assert loop.value == pytest.approx(100, abs=1)
    (stale,) = told.alarms_of("stale")
    assert 150 * NS < stale.start_pts_ns < 215 * NS  # before it was sure


def test_pictures_that_come_again_are_a_loop_at_once() -> None:
    loop = looped(100, 40)
    told = said([reference(), *Camera(filmed=loop, picture=loop).messages(150)])
    assert told.first("stale").header.pts_ns <= 103 * NS
    (alarm,) = told.alarms_of("loop")
    assert (alarm.value, alarm.unit, alarm.severity) == (40.0, "s", "alarm")
    assert "40.00 s" in told.verdicts[-1].evidence


def test_a_delayed_replay_was_never_live_and_its_time_is_found() -> None:
    told = said([reference(), *Camera(filmed=lambda t: t - 300.0).messages(200)])
    assert told.story == ["undecided", "stale"]
    end = told.verdicts[-1]
    assert end.lag_s == pytest.approx(300.3, abs=1.0)
    taken_s = (end.origin_utc_ns - T0_NS) / NS
    assert taken_s == pytest.approx(START_S + end.header.pts_ns / NS - 300, abs=1.5)


def test_who_cuts_back_to_the_present_is_live_again() -> None:
    camera = Camera(filmed=lambda t: t if not 120 <= t < 200 else t - 100)
    told = said([reference(), *camera.messages(340)])
    assert told.story == ["undecided", "live", "stale", "live"]
    assert [a.active for a in told.alarms_of("stale")] == [True, False]


def test_a_splice_is_a_jump_and_then_goes_on() -> None:
    camera = Camera(filmed=lambda t: t if t < 120 else t + 1 / 30)
    told = said([reference(), *camera.messages(220)])
    assert told.story == ["undecided", "live"]
    on, off = told.alarms_of("phase_jump")
    assert (on.active, off.active) == (True, False)
    assert abs(on.start_pts_ns - 120 * NS) <= NS
    assert on.value == pytest.approx(2 * np.pi * (100 / 30 - 3), abs=0.3)
    assert abs(on.value) > on.limit


def test_frames_that_slip_are_a_jump_with_their_count() -> None:
    """A tracker that has bridged them tells of them; the phase itself shows no jump any more."""
    messages = list(Camera().messages(160))
    for i, m in enumerate(messages):
        if isinstance(m, EnfEstimate) and m.start_pts_ns in (80 * NS, 130 * NS):
            lost = 1 if m.start_pts_ns == 80 * NS else -2
            messages[i] = dataclasses.replace(
                m, slips=1, slip_frame=np.array([2407]), slip_frames=np.array([lost])
            )
    told = said([reference(), *messages])
    assert told.story == ["undecided", "live"]
    lost, off, again = told.alarms_of("phase_jump")
    assert (lost.active, off.active, again.active) == (True, False, True)
    assert (lost.start_pts_ns, again.start_pts_ns) == (80 * NS, 130 * NS)
    assert (lost.value, again.value, lost.unit) == (1.0, 2.0, "frames")
    assert "1 lost at frame 2407" in lost.text
    assert "2 sent twice at frame 2407" in again.text


def test_one_second_that_went_wrong_is_no_jump() -> None:
    bad = dataclasses.replace
    messages = list(Camera().messages(120))
    for i, m in enumerate(messages):
        if isinstance(m, EnfEstimate) and m.start_pts_ns == 80 * NS:
            messages[i] = bad(m, amplitude_re=-m.amplitude_re, amplitude_im=-m.amplitude_im)
    assert said([reference(), *messages]).alarms == []


def test_a_picture_that_stands_is_frozen_and_then_not() -> None:
    camera = Camera(picture=lambda t: 100.0 if 100 <= t < 130 else t)
    told = said([reference(), *camera.messages(150)])
    assert told.story == ["undecided", "live", "frozen", "live"]
    assert told.first("frozen").header.pts_ns <= 107 * NS
    assert [a.active for a in told.alarms_of("frozen")] == [True, False]


def test_another_lamp_and_the_dark() -> None:
    lamp = Camera(size=lambda t: 6.0 if t < 100 else 2.0)
    told = said([reference(), *lamp.messages(200)])
    assert told.first("live")
    assert told.alarms_of("light_changed")[0].value == pytest.approx(1 / 3, rel=0.05)
    dark = said([reference(), *Camera(usable=lambda t: t < 80).messages(160)])
    assert dark.story == ["undecided", "live", "no_signal"]
    assert dark.verdicts[-1].evidence == "no mains flicker stands out"


def test_what_was_live_before_the_lamps_went_out_says_nothing_of_now() -> None:
    def usable(t_s: float) -> bool:
        return not 120 <= t_s < 420

    honest = said([reference(), *Camera(usable=usable).messages(520)])
    assert honest.story == ["undecided", "live", "no_signal", "undecided", "live"]
    swapped = Camera(usable=usable, filmed=lambda t: t if t < 400 else t - 300)
    told = said([reference(), *swapped.messages(560)])
    assert told.story == ["undecided", "live", "no_signal", "stale"]


def test_reconnecting_is_judged_anew_and_no_alarm() -> None:
    first, again = Camera(), Camera(epoch=1, start_s=START_S + 123.0, late_s=0.9, seed=2)
    told = said([reference(), *first.messages(120), *again.messages(120)])
    assert told.story == ["undecided", "live", "undecided", "live"]
    assert told.alarms == []
    seqs = [v.header.seq for v in told.verdicts if v.header.epoch == 1]
    assert seqs == list(range(len(seqs)))
    replayed = Camera(epoch=1, start_s=START_S + 123.0, filmed=lambda t: t - 123.0)
    told = said([reference(), *first.messages(120), *replayed.messages(120)])
    assert told.story == ["undecided", "live", "undecided", "stale"]


def test_a_restarted_tracker_goes_on_with_the_verdict() -> None:
    """Its estimates are of another run, and begin once more with what its sender had kept."""
    camera, killed_s = Camera(), 120
    slips = {"slips": 1, "slip_frame": np.array([7]), "slip_frames": np.array([1])}

    def restarted(second: int) -> EnfEstimate:
        made = camera.estimate(second, max(second, killed_s) + AHEAD_S)
        return dataclasses.replace(made, header=dataclasses.replace(made.header, run_id="r.track1"))

    seen: list[Any] = [reference()]
    for message in camera.messages(300):
        if not isinstance(message, EnfEstimate) or message.header.seq < killed_s:
            seen.append(message)
        else:
            first = 50 if message.header.seq == killed_s else message.header.seq
            seen += map(restarted, range(first, message.header.seq + 1))
    seen = [
        dataclasses.replace(m, **slips) if m.header.seq == 60 and isinstance(m, EnfEstimate) else m
        for m in seen
    ]
    told = said(seen)
    assert told.story == ["undecided", "live"]
    assert [alarm.active for alarm in told.alarms_of("phase_jump")] == [True, False]


@pytest.mark.parametrize(("began_s", "is_rate_known"), [(40, True), (80, True), (80, False)])
def test_a_restarted_tracker_need_not_know_of_lost_frames(
    began_s: int, is_rate_known: bool
) -> None:
    """One that began after them times the frames by their stamps, which are early since."""
    camera, lost, rate_hz = Camera(), 2, 29.97
    seen: list[Any] = [reference()]
    for message in camera.messages(300):
        if not isinstance(message, EnfEstimate):
            seen.append(message)
            continue
        second = message.header.seq
        made = dataclasses.replace(message, frame_rate_hz=rate_hz)
        if second in (60, 61):
            frames = {"slip_frame": np.array([7]), "slip_frames": np.array([1])}
            made = dataclasses.replace(made, slips=1, **frames)
        if second >= 120:
            turns = lost * 2 * made.enf_hz / rate_hz if began_s > 61 else 0.0
            wave = np.exp(2j * np.pi * turns) * (made.amplitude_re + 1j * made.amplitude_im)
            header = dataclasses.replace(made.header, run_id="r.track1")
            made = dataclasses.replace(
                made, header=header, origin_pts_ns=began_s * NS,
                frame_rate_hz=rate_hz if is_rate_known else 0.0,
                amplitude_re=wave.real, amplitude_im=wave.imag,
            )  # fmt: skip
        seen.append(made)
    told = said(seen)
    # Without the rate, phases can't be compared with those before.
    assert told.story == ["undecided", "live"] + ["undecided"] * (not is_rate_known)
    assert {alarm.start_pts_ns for alarm in told.alarms_of("phase_jump")} == {60 * NS}


def test_estimates_that_stay_away_are_neither_a_gap_of_the_reference_nor_darkness() -> None:
    messages = list(Camera().messages(300))
    kept = [m for m in messages if not isinstance(m, EnfEstimate) or m.header.seq < 120]
    told = said([reference(), *kept])
    assert told.story == ["undecided", "live", "undecided"]
    assert "no estimate for" in told.verdicts[-1].evidence


def test_a_tracker_that_still_searches_is_no_darkness() -> None:
    """It sends nothing for up to a minute, then either all seconds, or why it has none."""
    late = [m for m in Camera().messages(100) if not isinstance(m, EnfEstimate)]
    told = said([reference(), *late])
    assert told.story == ["undecided"]
    assert "has only begun" in told.verdicts[70].evidence
    assert "no estimate for" in told.verdicts[-1].evidence


def test_silence_is_lost_until_a_picture_comes() -> None:
    live, cam = Live(), Camera()
    messages = [reference(), *cam.messages(60)]
    out = [one for message in messages for one in live.update(message)]
    assert live.update(Silence(Header()))[0].kind == "lost"
    assert live.update(Silence(Header())) == []  # said once
    back = Camera(epoch=1, start_s=START_S + 90)
    told = said(back.messages(20), live)
    (over,) = told.alarms_of("lost")
    assert (over.active, over.header.epoch) == (False, 1)
    assert over.value == pytest.approx(30, abs=0.5)  # the outage, on the clock that both share
    assert over.in_short == f"lost ended at 0.8 s of epoch 1: no picture for {over.value:.1f} s"
    # Nobody may have had a clock: then it is said when the pictures are back.
    unwatched = said([*messages, *back.messages(20)])
    assert [a.active for a in unwatched.alarms_of("lost")] == [True, False]
    assert out[-1].verdict == "live"


def test_rows_that_were_in_hand_as_the_pictures_stopped_end_no_outage() -> None:
    *before, last = [m for m in Camera().messages(60) if isinstance(m, RowBlock)]
    back = Camera(epoch=1, start_s=START_S + 90).messages(20)
    told = said([reference(), *before, Silence(Header()), last, *back])
    assert [a.active for a in told.alarms_of("lost")] == [True, False]
    assert told.alarms_of("lost")[1].header.epoch == 1
    # Rows that go on to come without a gap were only late.
    *before, last, late = [m for m in Camera().messages(60) if isinstance(m, RowBlock)]
    told = said([reference(), *before, Silence(Header()), last, late])
    assert [a.active for a in told.alarms_of("lost")] == [True, False]


def test_frames_that_this_host_dropped_are_no_outage() -> None:
    """Their numbers are missing, too; where a camera is silent, the numbers go on."""

    def after(dropped: int) -> Said:
        kept = [m for m in Camera().messages(200) if not 100 <= m.header.pts_ns / NS < 108]
        for i, m in enumerate(kept):
            if isinstance(m, RowBlock) and m.header.pts_ns > 100 * NS:
                kept[i] = dataclasses.replace(m, frame_number=m.frame_number - 8 * RATE + dropped)
        return said([reference(), *kept])

    dropped = after(8 * RATE)
    assert dropped.alarms == []
    assert dropped.story == ["undecided", "live", "undecided", "live"]
    not_judged = [v for v in dropped.verdicts if "not judged" in v.evidence]
    assert [v.evidence for v in not_judged] == [
        f"not judged: rsenf is behind: {8 * RATE} frames dropped"
    ]
    assert not_judged[0].header.pts_ns == 108 * NS
    for of_silence in (0, 2 * RATE):  # a few dropped frames hide no outage
        lost = after(of_silence)
        assert [a.active for a in lost.alarms_of("lost")] == [True, False]


@pytest.mark.parametrize(("ahead_s", "times"), [(5, 1), (6, 2), (3600, 2)])
def test_a_clock_set_ahead_is_no_outage(ahead_s: int, times: int) -> None:
    """The stamps jump, but the pictures go on to arrive; a larger jump is judged anew."""
    shift_ns = ahead_s * NS

    def moved(message: Any) -> Any:
        header = message.header
        if header.pts_ns < 100 * NS:
            return message
        header = dataclasses.replace(header, pts_ns=header.pts_ns + shift_ns)
        names = ("start_pts_ns", "end_pts_ns", "amplitude_pts_ns", "frame_pts_ns")
        times = {n: getattr(message, n) + shift_ns for n in names if hasattr(message, n)}
        return dataclasses.replace(message, header=header, **times)

    told = said([reference(), *map(moved, Camera().messages(220))])
    assert told.alarms == []
    assert told.story == times * ["undecided", "live"]


def test_a_reference_that_pauses_leaves_it_undecided_and_no_alarm() -> None:
    def growing() -> Any:
        for message in Camera().messages(330):
            if isinstance(message, RowBlock):
                now = int(START_S) + message.header.pts_ns // NS
                paused = START_S + 100 < now < START_S + 200
                if not paused and now != START_S + 200:
                    yield reference(now - 1, now, total=0)
                if now == START_S + 200:  # what was missed, at once
                    yield reference(now - 100, now, total=0)
            yield message

    told = said([reference(0, int(START_S), total=0), *growing()])
    assert told.story == ["undecided", "live", "undecided", "live"]
    assert "ended" in told.verdicts[160].evidence
    assert told.alarms == []


def test_no_reference_or_another_grid_s_is_undecided() -> None:
    alone = said(Camera().messages(120))
    assert alone.story == ["undecided"]
    assert alone.verdicts[-1].evidence == "no reference with a known time"
    other = dataclasses.replace(reference(), nominal_hz=60.0)
    assert said([other, *Camera().messages(120)]).story == ["undecided"]
    timeless = dataclasses.replace(reference(), t0_ns=0)
    assert said([timeless, *Camera().messages(60)]).story == ["undecided"]


def test_the_future_of_a_reference_counts_for_nothing() -> None:
    """A file holds all of it at once; a topic only what has been."""
    camera = Camera(filmed=looped(100, 60))
    whole = said([reference(), *camera.messages(200)])
    cut = reference(0, int(START_S) + 205)
    changed = dataclasses.replace(
        reference(), freq_hz=np.concatenate([cut.freq_hz, np.full(GRID_S - cut.samples, 50.2)])
    )
    assert [canonical(v) for v in said([changed, *camera.messages(200)]).verdicts] == [
        canonical(v) for v in whole.verdicts
    ]


def test_the_order_of_streams_makes_no_difference() -> None:
    """Rows, estimates and reference come from different processes."""
    camera = Camera(filmed=looped(100, 60))
    messages = list(camera.messages(200))
    one = said([reference(), *messages])
    for late_s in ({RowBlock: 0.0, EnfEstimate: 2.4}, {RowBlock: 2.4, EnfEstimate: 0.0}):
        order = sorted(messages, key=lambda m: m.header.arrival_time_ns / NS + late_s[type(m)])
        pieces = [reference(first, first + 100) for first in range(0, GRID_S, 100)]
        other = said([*order[:20], *pieces, *order[20:]])
        assert [canonical(v) for v in other.verdicts] == [canonical(v) for v in one.verdicts]
        assert [canonical(a) for a in other.alarms] == [canonical(a) for a in one.alarms]


@pytest.mark.parametrize("seed", range(4))
def test_noise_is_never_live(seed: int) -> None:
    rng = np.random.default_rng(seed)
    messages = list(Camera(seed=seed).messages(200))
    for i, m in enumerate(messages):
        if isinstance(m, EnfEstimate):
            turn = rng.uniform(0, 2 * np.pi)
            made = {"amplitude_re": np.cos([turn]), "amplitude_im": np.sin([turn])}
            messages[i] = dataclasses.replace(m, **made)
    assert "live" not in said([reference(), *messages]).story


def test_empty_blocks_and_no_blocks_say_nothing() -> None:
    assert Live().flush() == []
    assert Live().update(RowBlock(header=Header())) == []
    assert Live().update(ReferenceBlock(header=Header())) == []


def test_a_camera_that_has_never_delivered_is_lost_until_it_does() -> None:
    live, cam = Live(), Camera()
    header = next(iter(cam.messages(1))).header
    silence = Silence(Header(run_id=header.run_id, source="site/cam"))
    verdict, alarm = sorted(live.update(silence), key=lambda m: type(m).__name__, reverse=True)
    assert (verdict.verdict, verdict.evidence) == ("undecided", "no picture yet")
    assert (alarm.kind, alarm.active, alarm.header.source) == ("lost", True, "site/cam")
    assert live.update(silence) == []  # said once
    told = said([reference(), *cam.messages(120)], live)
    assert [a.active for a in told.alarms_of("lost")] == [False]
    assert told.story == ["undecided", "live"]
    # In the same epoch: the numbers go on.
    seqs = [v.header.seq for v in [verdict, *told.verdicts]]
    assert seqs == list(range(len(seqs)))
    assert [a.header.seq for a in [alarm, *told.alarms]] == [0, 1]


def test_a_camera_that_is_lost_stays_so_when_its_watcher_leaves() -> None:
    live, cam = Live(), Camera()
    for message in [reference(), *cam.messages(60)]:
        live.update(message)
    (lost,) = (m for m in live.update(Silence(message.header)) if isinstance(m, Alarm))
    assert (lost.kind, lost.active) == ("lost", True)
    assert not [m for m in live.flush() if isinstance(m, Alarm)]


def mangled(message: Any, rng: np.random.Generator) -> Any:
    """A message whose numbers may be anything that their types allow."""
    wild = [0, -1, 1, 2**40, 2**62, -(2**62)]
    changes: dict[str, Any] = {}
    for part in dataclasses.fields(message):
        value = getattr(message, part.name)
        if rng.random() > 0.3 or part.name in ("header", "samples", "frames", "rows", "strips"):
            continue
        if isinstance(value, float):
            changes[part.name] = float(rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300]))
        elif isinstance(value, int) and not isinstance(value, bool) and part.name != "points":
            changes[part.name] = wild[rng.integers(len(wild))]
        elif isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size:
            changes[part.name] = value * rng.choice([np.nan, np.inf, 1e30, 0.0])
        elif isinstance(value, np.ndarray) and value.dtype == np.int64:
            changes[part.name] = value + wild[rng.integers(len(wild))] // 2
    header = message.header
    if rng.random() < 0.3:
        header = dataclasses.replace(header, pts_ns=wild[rng.integers(len(wild))])
    if rng.random() < 0.2:
        header = dataclasses.replace(header, arrival_time_ns=wild[rng.integers(4)])
    return dataclasses.replace(message, header=header, **changes)


@pytest.mark.parametrize("seed", [1, 5, 7])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_messages_of_any_numbers_are_lived_through(seed: int) -> None:
    rng = np.random.default_rng(seed)
    live, camera = Live(), Camera(epoch=5)
    pieces = [reference(first, first + 600) for first in range(0, GRID_S, 600)]
    for message in [*pieces, *Camera().messages(40)]:
        for one in (message, mangled(message, rng)):
            live.update(one)
    whole = [reference(), *camera.messages(120)]
    assert said(whole, live).verdicts[-1].verdict == "live"  # and what follows is judged as ever


def test_a_clock_that_steps_back_begins_anew() -> None:
    late = Camera(start_s=START_S + 100.0)
    told = said([reference(), *Camera().messages(100), *late.messages(100)])
    assert told.story == ["undecided", "live", "undecided", "live"]


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(UsageError, match="stale < 0 < live"):
        Limits(live=-1, stale=-2, most=3, least=-3)
    with pytest.raises(UsageError, match="lost_s"):
        LiveSettings(lost_s=0)
    with pytest.raises(UsageError, match="3 to 1 s old"):
        LiveSettings(earliest_s=3, latest_s=1)
