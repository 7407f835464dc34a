"""The pipeline in one process: what it collects, and that the way in changes nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from rsenf.match import Match
from rsenf.messages import Frame, Header, ReferenceBlock, RowBlock
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import blocks_from_luminance
from rsenf.run.inline import Analysis, analyse
from rsenf.run.inputs import Input
from rsenf.track import TrackSettings

RATE_HZ = 30.0
SETTINGS: dict[str, Any] = {
    "rows": RowsSettings(),
    "track": TrackSettings(method="stft", nominal_hz=50.0),
}


class Given(Input):
    """Messages that a test made."""

    def __init__(self, messages: list[Any], begins_with: str = "rows") -> None:
        self.name, self.begins_with, self._messages = "given", begins_with, messages

    def messages(self) -> Iterator[Any]:
        yield from self._messages


def wave(seconds: float, rows: int = 16) -> tuple[np.ndarray, np.ndarray]:
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    at_s = time_s[:, None] + np.arange(rows) * 0.5 / RATE_HZ / rows
    return (100 + 8 * np.cos(2 * np.pi * 100.06 * at_s))[:, :, None], time_s


def row_blocks(seconds: float, *, epoch: int = 0, begin_s: float = 0.0) -> list[RowBlock]:
    level, time_s = wave(seconds)
    blocks = blocks_from_luminance(level, time_s + begin_s, Header(source="test/cam1"))
    return [
        dataclasses.replace(b, header=dataclasses.replace(b.header, epoch=epoch)) for b in blocks
    ]


def test_rows_become_estimates() -> None:
    out = analyse(Given(row_blocks(30.0)), **SETTINGS)
    assert [e.t_s for e in out.estimates] == [10.0 + k for k in range(11)]
    assert np.median([e.enf_hz for e in out.estimates]) == pytest.approx(50.03, abs=1e-4)
    assert out.seconds == pytest.approx(30.0, abs=0.1)
    assert out.row_reasons == {"": len(row_blocks(30.0))}
    assert (out.results, out.loss, out.warnings) == ([], "", [])


def test_everything_passes_the_tap_and_progress_rises() -> None:
    topics: list[str] = []
    done: list[float] = []
    given = Given(row_blocks(22.0))
    analyse(
        given, **SETTINGS, progress=done.append, tap=lambda topic, message: topics.append(topic)
    )
    assert topics.count("rows") == len(list(given.messages()))
    assert topics.count("track") == 3
    assert done == sorted(done)
    assert done[-1] == pytest.approx(22.0, abs=0.1)


def test_frames_go_through_the_rows_stage() -> None:
    level, time_s = wave(21.0)
    frames = [
        Frame(
            header=Header(source="test/cam1", seq=n, frame_first=n, frame_last=n,
                          pts_ns=round(t * 1e9)),
            height_px=16, width_px=8,
            luma=np.repeat(np.rint(picture), 8, axis=1).astype(np.uint8),
        )
        for n, (t, picture) in enumerate(zip(time_s, level, strict=True))
    ]  # fmt: skip
    topics: list[str] = []
    out = analyse(
        Given(frames, "frames"), **SETTINGS, tap=lambda topic, message: topics.append(topic)
    )
    assert topics.count("rows") == 79  # the last of them not full
    assert [e.usable for e in out.estimates] == [True, True]
    assert out.seconds == pytest.approx(21.0, abs=0.1)


def reference() -> list[ReferenceBlock]:
    freq_hz = 50.01 + 0.01 * np.sin(np.arange(600) / 40)
    return [ReferenceBlock(
        header=Header(source="reference/test"), grid="test", nominal_hz=50.0, step_ns=10**9,
        first=0, samples=600, total=600, freq_hz=freq_hz, readings=np.ones(600, np.uint32),
    )]  # fmt: skip


def matched(messages: list[Any]) -> Analysis:
    return analyse(Given(messages), **SETTINGS, make_match=Match, reference=reference())


def test_an_empty_recording_has_a_result_too() -> None:
    out = matched([])
    assert out.result.decision == "no_decision"
    assert out.result.reason
    assert out.estimates == []


def test_the_reference_is_there_before_the_estimates() -> None:
    out = matched(row_blocks(60.0))
    assert len(out.results) == 1
    assert out.result.final
    assert out.result.grid == "test"
    assert out.result.seconds_used > 0


def test_a_source_that_restarted_is_judged_by_its_longest_stretch() -> None:
    messages = [
        *row_blocks(25.0), *row_blocks(60.0, epoch=1, begin_s=500.0), *row_blocks(22.0, epoch=2)
    ]  # fmt: skip
    out = matched(messages)
    assert out.stretches_s == pytest.approx([25.0, 60.0, 22.0], abs=0.1)
    assert out.seconds == pytest.approx(107.0, abs=0.2)
    assert [r.header.epoch for r in out.results] == [0, 1, 2]
    assert out.result.header.epoch == 1
    assert {e.header.epoch for e in out.estimates} == {0, 1, 2}
    assert [e.t_s for e in out.estimates if e.header.epoch == 1][:2] == [10.0, 11.0]
    assert out.warnings == ["the source restarted: 3 stretches"]


def test_the_frame_rate_is_that_of_all_the_recording() -> None:
    """Not of its first second, which lacks a frame here, nor of its last, which isn't full."""
    level, time_s = wave(12.3)
    kept = np.arange(len(time_s)) != 5
    blocks = blocks_from_luminance(level[kept], time_s[kept], Header(source="test/cam"))
    out = analyse(Given(list(blocks)), rows=RowsSettings(), track=TrackSettings())
    rate_hz = (len(time_s) - 1) / (time_s[-1] - time_s[0])
    assert out.frame_rate_hz == pytest.approx(rate_hz, rel=1e-6)
    assert out.estimates[0].frame_rate_hz == pytest.approx(rate_hz, rel=1e-6)


def test_why_rows_are_of_no_use_is_counted() -> None:
    bad = [
        dataclasses.replace(b, usable=False, reason="dark") if n % 2 else b
        for n, b in enumerate(row_blocks(22.0))
    ]
    out = analyse(Given(bad), **SETTINGS)
    assert out.row_reasons["dark"] == len(bad) // 2
    assert not any(e.usable for e in out.estimates)
