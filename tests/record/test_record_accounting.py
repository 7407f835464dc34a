"""Sequence numbers are accounted for, and times lie on one line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from record_samples import NOW_NS, ROWS, SECOND_NS, Clock, header, rows

from rsenf.messages import (
    EnfEstimate,
    Header,
    Health,
    IdleEstimate,
    Mark,
    MatchResult,
    ReferenceBlock,
    RowBlock,
)
from rsenf.record import Recorder, open_recording
from rsenf.record.reader import last_headers
from rsenf.record.sequence import (
    KEPT_GAPS,
    KEPT_STREAMS,
    LATEST_NS,
    MessagePlace,
    Numbers,
    Timeline,
    TopicTally,
    count_of,
)


@given(st.lists(st.integers(-20, 40), min_size=1, max_size=60))
def test_numbers_are_a_set(sequence):
    numbers, oracle = Numbers(), set()
    for number in sequence:
        assert numbers.add(number) == (number not in oracle)
        oracle.add(number)
    assert numbers.first == min(oracle)
    for start in (min(oracle), min(oracle) - 3):
        assert numbers.missing(start) == max(oracle) - start + 1 - len(oracle)


def test_forgotten_gaps_stay_counted():
    numbers = Numbers()
    for number in range(0, 4 * KEPT_GAPS, 2):
        assert numbers.add(number)
    assert numbers.missing(0) == 2 * KEPT_GAPS - 1
    assert not numbers.add(1)  # too old to tell
    assert numbers.add(4 * KEPT_GAPS - 3)
    assert numbers.missing(0) == 2 * KEPT_GAPS - 2


def test_gaps_duplicates_and_epochs():
    tally = TopicTally()
    taken = [tally.take(header(seq)) for seq in (5, 6, 6, 9, 8, 5)]
    assert taken == [True, True, False, True, True, False]
    assert (tally.messages, tally.duplicates, tally.missed, tally.joined_at) == (4, 2, 1, 5)
    assert tally.take(header(3))  # history that a late joiner asked for
    assert (tally.missed, tally.joined_at) == (2, 3)
    assert tally.take(header(2, epoch=1))  # this epoch began under our eyes
    assert tally.missed == 4
    assert tally.take(header(0, run_id="another"))
    assert (tally.missed, tally.messages) == (4, 7)


def test_missed_messages_outlive_their_epoch():
    tally = TopicTally()
    for epoch in range(3 * KEPT_STREAMS):
        tally.take(header(0, epoch=epoch))
        tally.take(header(2, epoch=epoch))
    assert tally.missed == 3 * KEPT_STREAMS


def test_what_is_no_count_any_more_is_none():
    texts = (None, "", "-", "--5", "5p", " 5", "٥", "9" * 20, "9" * 5000)
    assert [count_of(text) for text in texts] == [None] * len(texts)
    assert [count_of(text) for text in ("0", "-3", "17")] == [0, -3, 17]
    assert MessagePlace.read(str(MessagePlace("a run", 2, 5))) == MessagePlace("a run", 2, 5)
    for text in ("", "5 2", "5p 2 run", "5 -- run"):
        with pytest.raises(ValueError, match=r"."):
            MessagePlace.read(text)


def test_duplicates_are_not_recorded(tmp_path):
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        taken = [recorder.write(ROWS, rows(seq)) for seq in (0, 1, 1, 0, 3)]
        assert taken == [True, True, False, False, True]
        assert recorder.tallies[ROWS].missed == 1
    read = [m.header.seq for _, m, _ in open_recording(tmp_path / "a.mcap").messages()]
    assert read == [0, 1, 3]


def test_a_message_that_came_late_is_not_where_the_next_file_begins(tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder(path, run_info={}, clock_ns=Clock()) as recorder:
        for seq in (0, 1, 3, 2):
            recorder.write(ROWS, rows(seq))
    assert last_headers(path)[ROWS].seq == 3


def test_a_file_processed_fast_lies_at_stream_speed():
    timeline = Timeline(Clock())
    # An hour of video arrives within three seconds; estimates come later than what they're from.
    for seq in range(0, 90_000, 1000):
        fast = header(seq, arrival_time_ns=NOW_NS + seq * 33_000)
        assert timeline.log_time_ns(RowBlock, fast) == NOW_NS + seq * 40_000_000
    late = header(0, pts_ns=20 * SECOND_NS, arrival_time_ns=NOW_NS + 9 * SECOND_NS)
    assert timeline.log_time_ns(EnfEstimate, late) == NOW_NS + 20 * SECOND_NS


def test_streams_and_epochs_have_anchors_of_their_own():
    timeline = Timeline(Clock())
    pts_ns = 95_000 * SECOND_NS  # RTP clocks begin anywhere

    def log_time_ns(**changed):
        return timeline.log_time_ns(RowBlock, header(0, **changed))

    assert log_time_ns(pts_ns=pts_ns) == NOW_NS
    assert log_time_ns(pts_ns=pts_ns + 7) == NOW_NS + 7
    assert log_time_ns(source="site/other", pts_ns=5) == NOW_NS
    assert log_time_ns(epoch=1, pts_ns=0, arrival_time_ns=NOW_NS + 99) == NOW_NS + 99
    assert log_time_ns(epoch=1, pts_ns=8, arrival_time_ns=NOW_NS + 500) == NOW_NS + 107


def live(timeline, seconds, ahead_s=lambda t: 0.0, cls=RowBlock, **changed):
    """Log a message of each second; return how far each lies from the stream's own clock, in s."""
    lies = []
    for t in seconds:
        arrival_ns = NOW_NS + round((t + ahead_s(t)) * SECOND_NS)
        head = header(0, pts_ns=t * SECOND_NS, arrival_time_ns=arrival_ns, **changed)
        lies.append((timeline.log_time_ns(cls, head) - NOW_NS) / SECOND_NS - t)
    return lies


def test_a_source_that_is_started_anew_lies_where_it_came_the_second_time():
    timeline = Timeline(Clock())
    assert live(timeline, range(5), run_id="a") == [0.0] * 5
    assert live(timeline, range(5), lambda _: 3600.0, run_id="b") == [3600.0] * 5
    # What of the first is late still belongs to it.
    assert live(timeline, [5], run_id="a") == [0.0]
    for n in range(2 * KEPT_STREAMS):
        assert live(timeline, [0], lambda _: 5.0, run_id=str(n)) == [5.0]
    assert len(timeline._sources["site/cam"]) == KEPT_STREAMS


def test_a_live_stream_follows_a_clock_that_is_set():
    timeline = Timeline(Clock())
    lies = live(timeline, range(100), lambda t: 7200.0 * (t >= 10))
    assert lies == [0.0] * 40 + [7200.0] * 60
    assert live(timeline, range(100, 200), lambda _: 0.0) == [7200.0] * 30 + [0.0] * 70
    # An estimate arrives long after the beginning of what it is of; a mark goes with the last.
    assert live(timeline, range(150, 190), lambda _: 40.0, cls=EnfEstimate) == [0.0] * 40
    end = header(200, mark=Mark.END)
    assert timeline.log_time_ns(RowBlock, end) == NOW_NS + 199 * SECOND_NS


def test_a_live_stream_stays_with_a_clock_that_drifts():
    timeline = Timeline(Clock())
    lies = live(timeline, range(0, 200_000, 5), lambda t: 5e-5 * t)
    assert all(
        abs(lag - 5e-5 * t) < 1.01 for t, lag in zip(range(0, 200_000, 5), lies, strict=True)
    )
    assert lies[-1] > 9.0


def test_a_file_keeps_its_own_speed_whatever_the_pace_of_its_processing():
    for pace in (0.0, 0.1, 0.9, 1.1, 5.0):
        lies = live(Timeline(Clock()), range(3600), lambda t, pace=pace: (pace - 1.0) * t)
        assert lies == [0.0] * 3600
    stalls = live(Timeline(Clock()), range(3600), lambda t: 4.0 * (t // 20))
    assert stalls == [0.0] * 3600


def test_what_is_of_all_so_far_gives_nobody_the_time():
    timeline = Timeline(Clock())
    for cls in (IdleEstimate, MatchResult):
        assert live(timeline, [0], lambda _: 3600.0, cls=cls) == [3600.0]
    assert live(timeline, range(3600, 3605)) == [0.0] * 5
    assert live(timeline, [0], lambda _: 3605.0, cls=IdleEstimate) == [0.0]


def test_marks_lie_where_their_stream_has_got_to():
    timeline = Timeline(Clock())
    begin = header(0, mark=Mark.BEGIN, pts_ns=0, arrival_time_ns=NOW_NS - 3)
    assert timeline.log_time_ns(RowBlock, begin) == NOW_NS - 3
    assert (
        timeline.log_time_ns(RowBlock, header(1, pts_ns=10**15, arrival_time_ns=NOW_NS)) == NOW_NS
    )
    timeline.log_time_ns(RowBlock, header(2, pts_ns=10**15 + 80))
    end = header(3, mark=Mark.END, pts_ns=0)
    assert timeline.log_time_ns(RowBlock, end) == NOW_NS + 80


def test_what_has_no_stream_time_goes_by_the_clock():
    clock = Clock()
    timeline = Timeline(clock)
    clock.advance(4)
    reference = header(0, source="reference/ce", pts_ns=10**12)
    for cls, head in (
        (Health, header(0)),
        (ReferenceBlock, reference),
        (EnfEstimate, reference),
    ):
        assert timeline.log_time_ns(cls, head) == NOW_NS + 4 * SECOND_NS
    unknown = header(0, source="x", arrival_time_ns=0, pts_ns=17)
    assert timeline.log_time_ns(RowBlock, unknown) == NOW_NS + 4 * SECOND_NS
    assert timeline.arrival_ns(unknown) == NOW_NS + 4 * SECOND_NS


@given(st.lists(st.tuples(*[st.integers(-(2**63), 2**63 - 1)] * 2), min_size=1, max_size=5))
def test_no_header_takes_the_time_out_of_bounds(pairs):
    timeline = Timeline(Clock())
    for seq, (pts_ns, arrival_ns) in enumerate(pairs):
        head = header(seq, pts_ns=pts_ns, arrival_time_ns=arrival_ns)
        assert 0 <= timeline.log_time_ns(RowBlock, head) <= LATEST_NS
        assert 0 <= timeline.arrival_ns(head) <= LATEST_NS


def test_hostile_headers_can_be_recorded(tmp_path):
    worst = [
        rows(0, pts_ns=-(2**63), arrival_time_ns=2**63 - 1, seq=-(2**63)),
        rows(1, pts_ns=2**63 - 1, arrival_time_ns=-(2**63), seq=2**63 - 1, mark=77, epoch=-1),
    ]
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        for message in worst:
            recorder.write(ROWS, message)
    read = [m.header for _, m, _ in open_recording(tmp_path / "a.mcap").messages()]
    assert read == [message.header for message in worst]


def test_after_a_clock_was_set_back_new_streams_are_recorded() -> None:
    """What a restarted recorder's file holds isn't recorded again, but for what it can't hold."""
    last = Header(run_id="r", seq=9, arrival_time_ns=5000 * SECOND_NS)
    for back_s, new in ((1, False), (599, False), (3600, True), (-1, True)):
        then = Header(run_id="r.track1", arrival_time_ns=last.arrival_time_ns - back_s * SECOND_NS)
        assert TopicTally.after(last).take(then) == new
