"""Pieces: all of the film, nothing twice, and nothing that tells where it was."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.bench.recording_time.trials import _pieces_of
from rsenf.messages import Header, RowBlock
from rsenf.rows.stage import blocks_from_luminance

RATE_HZ = 30000 / 1001
FIRST_S = 7.0


def rows(seconds: float) -> list[RowBlock]:
    frames = round(seconds * RATE_HZ)
    level = np.arange(frames, dtype=np.float32)[:, None, None] + np.zeros((1, 4, 2), np.float32)
    time_s = FIRST_S + np.arange(frames) / RATE_HZ
    return list(blocks_from_luminance(level, time_s, Header(source="a")))


@pytest.mark.parametrize(("length_s", "count"), [(60.0, 10), (120.0, 5), (300.0, 2), (600.0, 1)])
def test_pieces_follow_each_other(length_s: float, count: int) -> None:
    pieces = list(_pieces_of(rows(600.0), length_s))
    assert [piece.number for piece in pieces] == list(range(count))
    levels = np.concatenate([b.level[:, 0, 0] for piece in pieces for b in piece.blocks])
    assert np.array_equal(levels, np.arange(round(600 * RATE_HZ)))
    for piece in pieces:
        late_s = piece.begin_s - piece.number * length_s
        assert 0 <= late_s < 8 / RATE_HZ
        assert sum(b.frames for b in piece.blocks) / RATE_HZ == pytest.approx(length_s, abs=0.3)
        assert piece.blocks[0].level[0, 0, 0] == pytest.approx(piece.begin_s * RATE_HZ, abs=1e-3)


def test_a_piece_counts_from_its_own_first_frame() -> None:
    _, second = _pieces_of(rows(120.0), 60.0)
    first = second.blocks[0]
    assert (first.header.seq, first.header.frame_first, first.header.pts_ns) == (0, 0, 0)
    assert (first.frame_number[0], first.frame_pts_ns[0]) == (0, 0)
    assert [b.header.seq for b in second.blocks] == list(range(len(second.blocks)))
    stamps = np.concatenate([b.frame_pts_ns for b in second.blocks])
    assert np.allclose(np.diff(stamps), 1e9 / RATE_HZ, atol=2)


def test_what_is_left_over_is_not_a_piece() -> None:
    assert len(list(_pieces_of(rows(130.0), 60.0))) == 2
