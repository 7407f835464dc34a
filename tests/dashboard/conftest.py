"""A dashboard that is served."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from messages_of import SITE
from served import FEEDS, Served

from rsenf.dashboard.site import Wiring


@pytest.fixture
def served() -> Iterator[Served]:
    pytest.importorskip("uvicorn", reason="uvicorn isn't installed")
    feeds = {f"{SITE}/{name}": [f"decode-{name}", "track"] for name in FEEDS}
    one = Served(Wiring(feeds, frozenset(feeds)))
    with one.server, one.site:
        yield one
