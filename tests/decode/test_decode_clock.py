"""The rules by which a frame gets its time."""

from __future__ import annotations

from fractions import Fraction

import av

from rsenf.decode.packets import FrameClock

NTSC = Fraction(30000, 1001)
PERIOD_NS = 1_001_000_000_000 // 30000


def packet(pts: int | None, dts: int | None) -> av.Packet:
    made = av.Packet(b"x")
    made.pts, made.dts = pts, dts
    return made


def test_presentation_times_are_exact_however_long_it_runs() -> None:
    clock = FrameClock(Fraction(1, 30000), NTSC)
    hours = 30 * 3600 * 24 * 30
    assert clock.time_ns(hours * 1001) == round(hours * Fraction(1001, 30000) * 1_000_000_000)
    assert (clock.from_order, clock.from_rate) == (0, 0)


def test_without_them_frames_take_the_decoding_times_in_order() -> None:
    clock = FrameClock(1 / NTSC, NTSC)
    for dts in range(4):
        clock.expect(packet(None, dts))
    clock.forget()  # the first packet was damaged: its frame never came
    assert [clock.time_ns(None) // PERIOD_NS for _ in range(3)] == [1, 2, 3]
    assert clock.from_order == 3


def test_a_single_missing_time_keeps_the_delay_of_its_neighbours() -> None:
    clock = FrameClock(Fraction(1, 1000), Fraction(25))
    for n in range(3):
        clock.expect(packet(None, 40 * n))
    times = [clock.time_ns(80), clock.time_ns(None), clock.time_ns(160)]
    assert times == [80_000_000, 120_000_000, 160_000_000]


def test_without_any_the_declared_rate_counts() -> None:
    clock = FrameClock(Fraction(1, 1_200_000), NTSC)
    packets_ns = [clock.expect(packet(None, None)) for _ in range(3)]
    assert packets_ns == [0, 33_366_667, 66_733_333]
    assert [clock.time_ns(None) for _ in range(3)] == packets_ns
    assert clock.from_rate == 3
    clock.forget()  # a damaged packet shifts no later time
    assert clock.time_ns(None) == round(4 / NTSC * 1_000_000_000)
    assert clock.time_ns(1_200_000) == 1_000_000_000
    assert clock.time_ns(None) == 1_033_366_667
