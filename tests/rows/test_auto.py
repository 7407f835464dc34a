"""Both axes are sampled until one is chosen; what then comes is what that axis alone would give."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from rsenf.messages import Frame, Header, RowBlock, digest
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import LOOK_AFTER_S, MAX_FRAMES, AutoRows, Rows

RATE_HZ = 10


def film(count: int, rate_hz: float = RATE_HZ) -> list[Frame]:
    rng = np.random.default_rng(3)
    return [
        Frame(
            header=Header(source="t/c", seq=n, frame_first=n, frame_last=n,
                          pts_ns=round(n * 1e9 / rate_hz)),
            height_px=24, width_px=32, luma=rng.integers(60, 190, (24, 32), dtype=np.uint8),
        )
        for n in range(count)
    ]  # fmt: skip


def by(axis: str, frames: list[Frame]) -> list[RowBlock]:
    rows = Rows(RowsSettings(read_out_axis=axis))
    return [b for f in frames for b in rows.update(f)] + rows.flush()


class Judge:
    """Gives the answers that it was told, and remembers how much it was shown."""

    def __init__(self, *answers: str) -> None:
        self._answers, self.seen = list(answers), list[tuple[int, int]]()

    def __call__(self, rows: Sequence[RowBlock], columns: Sequence[RowBlock]) -> str:
        assert {b.rows for b in rows} == {24}
        assert {b.rows for b in columns} == {32}
        self.seen.append((sum(b.frames for b in rows), sum(b.frames for b in columns)))
        return self._answers.pop(0)


@pytest.mark.parametrize(
    ("answers", "axis", "looks"),
    [(["columns"], "columns", 1), (["rows"], "rows", 1), (["", "columns"], "columns", 2),
     (["", ""], "rows", 2)],
)  # fmt: skip
def test_the_chosen_axis_as_if_it_had_been_known(answers: list[str], axis: str, looks: int) -> None:
    frames, judge = film(300), Judge(*answers)
    stage = AutoRows(RowsSettings(read_out_axis="auto"), judge)
    sent = [stage.update(frame) for frame in frames]
    out = [b for blocks in sent for b in blocks] + stage.flush()
    assert digest(out) == digest(by(axis, frames))
    # Nothing before the decision, the backlog at it, and each block at once from then on.
    first = next(n for n, blocks in enumerate(sent) if blocks)
    assert first == LOOK_AFTER_S[looks - 1] * RATE_HZ
    assert len(sent[first]) == first // 8
    assert all(len(blocks) <= 1 for blocks in sent[first + 1 :])
    assert len(judge.seen) == looks


def test_a_short_film_is_judged_at_its_end() -> None:
    frames, judge = film(21), Judge("columns")
    stage = AutoRows(RowsSettings(read_out_axis="auto"), judge)
    assert [b for f in frames for b in stage.update(f)] == []
    assert digest(stage.flush()) == digest(by("columns", frames))
    assert judge.seen == [(21, 21)]


def test_what_is_held_is_bounded_whatever_the_time_stamps_say() -> None:
    frames, judge = film(MAX_FRAMES + 8, rate_hz=1e6), Judge("")
    stage = AutoRows(RowsSettings(read_out_axis="auto"), judge)
    out = [b for f in frames for b in stage.update(f)]
    assert judge.seen == [(MAX_FRAMES, MAX_FRAMES)]
    assert digest(out) == digest(by("rows", frames))


def test_nothing_at_all() -> None:
    stage = AutoRows(RowsSettings(read_out_axis="auto"), lambda rows, columns: "")
    assert stage.flush() == []
