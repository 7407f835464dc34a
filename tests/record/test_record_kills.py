"""A recording that is killed at any moment comes back but for its last second."""

from __future__ import annotations

import pytest

from tests.record.kills import Killed, recorder_alone, study


@pytest.mark.processes
def test_kills_at_random_moments(tmp_path):
    for killed in study(recorder_alone, 2, 40, tmp_path):
        print(killed)
        assert isinstance(killed, Killed)
        assert killed.messages > 0
        assert killed.lost_s <= 1.0 + killed.late_s
