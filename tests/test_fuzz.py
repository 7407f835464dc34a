"""Whatever is damaged: it is read, or refused with one of rsenf's own errors, within limits.

By hand, many more: ``python -m tests.fuzz --count 10000 --seed 1``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz import READ, REFUSED, fuzz
from tests.fuzz_readers import READERS


@pytest.mark.parametrize("name", READERS)
def test_damage_is_read_or_refused(name: str, tmp_path: Path) -> None:
    tally = fuzz(name, 30, 2, tmp_path / "case")
    assert tally.failures == {}
    assert tally.outcomes[READ] + tally.outcomes[REFUSED] == 30
