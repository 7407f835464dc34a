"""The life of a stage: END marks, epochs, two inputs; streaming equals batch."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from run_samples import Counting, block, end_after, wall

from rsenf.messages import (
    Alarm,
    EnfEstimate,
    Header,
    IdleEstimate,
    Mark,
    RowBlock,
    canonical,
    digest,
)
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows
from rsenf.run.runner import Branches, Pipeline, Runner
from rsenf.run.stages import rows_stage
from rsenf.stage import StageSpec
from rsenf.track import TrackSettings, make_tracker

SHORT = TrackSettings(method="stft", window_s=4.0, nominal_hz=50.0, max_std_hz=1.0)


def pipeline(tapped: list[Any]) -> Pipeline:
    track = StageSpec(("track",), ("rows",), lambda: make_tracker(SHORT))
    stages = [rows_stage(RowsSettings()), track]
    return Pipeline(stages, ("frames",), lambda topic, message: tapped.append(message))


def data(messages: list[Any], cls: type[Any]) -> list[Any]:
    return [m for m in messages if isinstance(m, cls) and not m.header.is_end]


def streamed(frames: list[Any]) -> list[Any]:
    """Everything that leaves the stages, fed frame by frame and ended."""
    out: list[Any] = []
    line = pipeline(out)
    for frame in frames:
        line.feed("frames", frame)
    line.feed("frames", end_after(frames[-1]))
    return out


def in_one_batch(frames: list[Any]) -> list[Any]:
    """The same stages, each given everything at once."""
    rows, track = Rows(), make_tracker(SHORT)
    blocks = [b for f in frames for b in rows.update(f)] + rows.flush()
    return blocks + [e for b in blocks for e in track.update(b)] + track.flush()


@settings(max_examples=15, deadline=None)
@given(
    st.integers(150, 300),
    st.sets(st.integers(0, 299), max_size=12),
)
def test_streaming_equals_batch_bit_for_bit(count: int, lost: set[int]) -> None:
    frames = [f for f in wall(count) if f.header.seq not in lost]
    out, batch = streamed(frames), in_one_batch(frames)
    assert digest(data(out, RowBlock)) == digest(data(batch, RowBlock))
    assert digest(data(out, EnfEstimate)) == digest(data(batch, EnfEstimate))
    assert len(data(out, EnfEstimate)) >= 1
    # From the sixth on, four seconds are too short to tell the grid from a quartz.
    assert all(e.usable for e in data(out, EnfEstimate)[:5]) or lost


def test_each_stage_ends_its_stream_once_and_numbers_on() -> None:
    out = streamed(list(wall(160)))
    for cls in (RowBlock, EnfEstimate):
        stream = [m for m in out if isinstance(m, cls)]
        assert [m.header.seq for m in stream] == list(range(len(stream)))
        assert [m.header.is_end for m in stream] == [False] * (len(stream) - 1) + [True]
        assert stream[-1].header.source == "lab/cam"


def test_an_epoch_begins_with_fresh_stages() -> None:
    first, second = list(wall(150)), list(wall(170, epoch=1))
    together = streamed(first + second)
    for epoch, alone in enumerate((streamed(first), streamed(second))):
        of_it = [m for m in together if m.header.epoch == epoch and not m.header.is_end]
        assert [canonical(m) for m in of_it if isinstance(m, RowBlock)] == [
            canonical(m) for m in data(alone, RowBlock)
        ]
        assert [canonical(m) for m in of_it if isinstance(m, EnfEstimate)] == [
            canonical(m) for m in data(alone, EnfEstimate)
        ]
    ends = [m for m in together if m.header.is_end]
    assert [e.header.epoch for e in ends] == [1, 1]


def test_another_run_of_the_source_is_another_epoch_too() -> None:
    runner = Runner("track", Counting)
    runner.feed(block(0))
    out = runner.feed(block(0, run_id="again"))
    assert [m.method for m in out] == ["flush"]
    assert out[0].header.run_id == "r"


def test_the_end_of_an_epoch_without_results_goes_by_that_epoch() -> None:
    runner = Runner("track", Counting)
    for seq in range(4):
        runner.feed(block(seq))
    (flushed,) = runner.feed(block(0, epoch=1))
    assert (flushed.header.epoch, flushed.header.seq) == (0, 2)
    *_, end = runner.end(Header())
    assert (end.header.epoch, end.header.is_end) == (1, True)


def test_a_stage_with_two_inputs_ends_with_the_last_of_them() -> None:
    runner = Runner("match", Counting, inputs=2)
    assert runner.feed(end_after(block(0))) == []
    assert not runner.ended
    runner.feed(block(0))
    runner.feed(block(0, epoch=1))  # it tells epochs apart by itself
    out = runner.end(Header(source="lab/cam"))
    assert runner.ended
    assert [m.header.mark for m in out] == [Mark.DATA, Mark.END]
    assert runner.end(Header()) == []


def test_a_stream_without_a_single_message_still_ends() -> None:
    end = Header(run_id="r", source="lab/cam", seq=7, mark=Mark.END)
    out = Runner("rows", Rows).feed(RowBlock(header=end))
    assert [(m.header.seq, m.header.source, m.header.is_end) for m in out] == [(0, "lab/cam", True)]


def test_each_branch_is_fed_and_ended_by_what_it_reads() -> None:
    rows, track = Counting(), Counting()
    of_rows, of_track = Runner("track", lambda: rows), Runner("idle", lambda: track)
    branches = Branches((("rows",), of_rows), (("track",), of_track))
    estimate = EnfEstimate(header=block(0).header)
    branches.feed(block(0))
    branches.feed(estimate)
    branches.feed(end_after(estimate))
    branches.feed(block(1))
    assert (of_rows.ended, of_track.ended) == (False, True)
    assert ([type(m) for m in rows.taken], len(track.taken)) == ([RowBlock, RowBlock], 1)
    branches.feed(end_after(block(1)))
    assert of_rows.ended


class Telling:
    """A stage of three topics."""

    def update(self, message: RowBlock) -> list[Any]:
        header = message.header
        return [EnfEstimate(header=header), IdleEstimate(header=header), Alarm(header=header)]

    def flush(self) -> list[Any]:
        return []


def test_a_stage_of_three_topics_ends_each_by_its_own_numbers() -> None:
    spec = StageSpec(("track", "idle", "alarm"), ("rows",), Telling)
    runner = Runner.of(spec, 1)
    sent = [*runner.feed(block(0)), *runner.feed(block(1)), *runner.feed(end_after(block(1)))]
    told = [(runner.topic_of(m), m.header.seq, m.header.is_end) for m in sent]
    assert told[3:6] == [("track", 1, False), ("idle", 1, False), ("alarm", 1, False)]
    assert told[6:] == [("track", 2, True), ("idle", 2, True), ("alarm", 2, True)]
