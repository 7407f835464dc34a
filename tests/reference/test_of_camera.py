"""Another camera as the reference: every second once, on the clock of the day."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from rsenf.messages import EnfEstimate, Header, ReferenceBlock, RowBlock
from rsenf.reference.live import CameraReference
from rsenf.timebase import NS_PER_S
from tests.reference.joined import joined

BEGAN_NS = 1_700_000_000 * NS_PER_S


def camera(
    seconds: int,
    *,
    epoch: int = 0,
    began_s: float = 0.0,
    ppm: float = 0.0,
    late_s: float = 3.0,
    jitter_s: float = 0.0,
) -> Iterator[RowBlock | EnfEstimate]:
    """Messages of a camera whose stream began so long after BEGAN_NS; 50 Hz + 1 mHz a second."""
    rng = np.random.default_rng(1)

    def header(pts_s: float, arrival_s: float) -> Header:
        clock = 1 - ppm * 1e-6
        delay_s = float(rng.exponential(jitter_s)) if jitter_s else 0.0
        return Header(
            run_id="r",
            source="lab/cam",
            epoch=epoch,
            seq=int(pts_s),
            pts_ns=round(pts_s * NS_PER_S),
            arrival_time_ns=BEGAN_NS + round((began_s + arrival_s * clock + delay_s) * NS_PER_S),
        )

    for k in range(seconds):
        yield RowBlock(header=header(k, k))
        yield EnfEstimate(
            header=header(k, k + 1 + late_s),
            nominal_hz=50.0,
            start_pts_ns=k * NS_PER_S,
            end_pts_ns=(k + 1) * NS_PER_S,
            enf_hz=50.0 + 1e-3 * k,
            enf_var_hz2=1e-6,
            usable=True,
        )


def fed(stage: CameraReference, messages: Iterator[RowBlock | EnfEstimate]) -> list[ReferenceBlock]:
    return [block for message in messages for block in stage.update(message)]


def follow_each_other(blocks: list[ReferenceBlock]) -> bool:
    ends = [block.first + block.samples for block in blocks]
    numbers = [block.header.seq for block in blocks]
    return [b.first for b in blocks] == [0, *ends[:-1]] and numbers == list(range(len(blocks)))


def test_each_estimate_is_a_second_at_the_time_it_was_filmed() -> None:
    blocks = fed(CameraReference("ce", run_id="n"), camera(100, jitter_s=0.1))
    assert follow_each_other(blocks)
    reference = joined(blocks)
    np.testing.assert_array_equal(reference.freq_hz, 50 + 1e-3 * np.arange(100))
    assert abs(reference.t0_ns - BEGAN_NS) < 0.2 * NS_PER_S
    assert {b.header.source for b in blocks} == {"reference/ce"}
    assert {(b.header.run_id, b.nominal_hz, b.total) for b in blocks} == {("n", 50.0, 0)}


def test_what_is_uncertain_or_unusable_or_no_first_choice_is_a_gap() -> None:
    messages = list(camera(6))
    messages[3] = dataclasses.replace(messages[3], usable=False)
    messages[5] = dataclasses.replace(messages[5], enf_var_hz2=1e-4)
    messages[7] = dataclasses.replace(messages[7], rank=1)
    freq_hz = joined(fed(CameraReference("ce"), iter(messages))).freq_hz
    assert np.isnan(freq_hz).tolist() == [False, True, True, True, False, False]


def test_a_clock_that_is_off_costs_a_second_now_and_then_and_repeats_none() -> None:
    for ppm in (200.0, -200.0):
        blocks = fed(CameraReference("ce"), camera(12_000, ppm=ppm, jitter_s=0.05))
        assert follow_each_other(blocks)
        reference = joined(blocks)
        parted = 12_000 * ppm * 1e-6  # seconds, between the two clocks
        assert abs(reference.freq_hz.size - (12_000 - parted)) <= 1
        assert abs(np.isnan(reference.freq_hz).sum() - max(-parted, 0)) <= 1
        told = reference.freq_hz[np.isfinite(reference.freq_hz)]
        assert np.all(np.diff(told) > 0)


def test_a_camera_that_is_away_leaves_a_gap() -> None:
    stage = CameraReference("ce")
    blocks = fed(stage, camera(20))
    blocks += fed(stage, camera(20, epoch=1, began_s=50.4))
    assert follow_each_other(blocks)
    freq_hz = joined(blocks).freq_hz
    assert freq_hz.size == 70
    assert np.isnan(freq_hz[20:50]).all()
    assert np.isfinite(freq_hz[50:]).all()
    # Back sooner than a second is over: that second isn't told again.
    again = fed(stage, camera(3, epoch=2, began_s=69.3))
    assert [b.first for b in again] == [70, 71]


def test_a_clock_that_is_set_back_begins_anew() -> None:
    stage = CameraReference("ce")
    first = fed(stage, camera(20))
    second = fed(stage, camera(20, epoch=1, began_s=-3600.0))
    assert {b.header.epoch for b in first} == {0}
    assert {b.header.epoch for b in second} == {1}
    assert follow_each_other(second)
    assert abs(second[0].t0_ns - (BEGAN_NS - 3600 * NS_PER_S)) < NS_PER_S


def test_without_rows_the_estimates_tell_the_time() -> None:
    tracks = (m for m in camera(20) if isinstance(m, EnfEstimate))
    reference = joined(fed(CameraReference("ce"), tracks))
    assert reference.t0_ns == BEGAN_NS + 3 * NS_PER_S
    assert np.isfinite(reference.freq_hz).all()


def test_a_restarted_tracker_goes_on_with_the_stream_of_the_rows() -> None:
    messages = list(camera(3000, ppm=50.0, jitter_s=0.08))
    for number, message in enumerate(messages[2000:], 2000):
        if isinstance(message, EnfEstimate):
            header = dataclasses.replace(message.header, run_id="r.track1")
            messages[number] = dataclasses.replace(message, header=header)
    freq_hz = joined(fed(CameraReference("ce"), iter(messages))).freq_hz
    assert np.isnan(freq_hz).sum() <= 1
    assert freq_hz.size >= 2999
