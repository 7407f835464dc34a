"""Rows in which flicker stands still are told apart once; those of the first minutes for good."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.zero_alias import ZeroAlias, separate
from rsenf.idle import moments
from rsenf.idle.moments import StillRows
from tests.idle.idle_clips import camera, film


def test_rows_are_told_apart_once_and_the_first_minutes_for_good(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[ZeroAlias | None] = []
    monkeypatch.setattr(moments, "separate", lambda *a: told.append(separate(*a)) or told[-1])
    monkeypatch.setattr(moments, "LONGEST_S", 30.0)
    data = film(camera("25"), 7, seconds=40)
    rows = StillRows(0.0)
    found = []
    for second in range(40):
        part = slice(25 * second, 25 * second + 25)
        rows.add(data.frame_time_s[part], data.level[part].astype(np.float32), second + 0.96)
        if not rows.enough:
            assert second < 8
        elif second % 10 == 9:
            found += [rows.told_apart(), rows.told_apart()]
    assert len(told) == 3
    assert found[0] is found[1] is told[0]
    assert found[-1] is found[-2] is told[-1]
    assert found[-1].t_s[-1] < 30.0
    assert rows.span_s == pytest.approx(29.96)
    assert rows.enough
