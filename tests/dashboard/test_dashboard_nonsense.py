"""Whatever a bus may carry: the page is told something that is JSON, and nothing breaks."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from messages_of import START_NS, Camera, grid_hz, reference

from rsenf.bus.keys import TOPICS
from rsenf.dashboard.app import Session
from rsenf.dashboard.site import Site, Wiring, file_named
from rsenf.messages import Header, decode, encode
from rsenf.messages.schema import field_specs
from rsenf.record.archive.layout import Camera as ArchivedCamera
from rsenf.record.archive.layout import new_path

DOOR = "house/door"
INTEGERS = (0, 1, -1, START_NS, -(2**63), 2**63 - 1)
FLOATS = (0.0, 50.0, -1.0, 1e300, float("inf"), float("nan"))
# How long a message's lists are, and what decides whether the rest of it is looked at.
SIZES = {"frames": 3, "rows": 2, "strips": 2, "points": 1, "samples": 3}
KEPT = {"rank": 0, "decision": "match", "verdict": "estimated", "grid": "ce", "method": "x"}
PLAIN = {"float": np.float32, "double": np.float64, "sfixed64": np.int64, "fixed32": np.uint32}
KEYS = {"reference": "rsenf/house/reference/ce", "health": "rsenf/house/@nodes/n/health"}


def full_of(cls: type[Any], integer: int, float_: float) -> Any:
    """A message that has one number everywhere, as it comes off the wire."""
    header = Header(source=DOOR, pts_ns=integer, arrival_time_ns=integer)
    values: dict[str, Any] = {}
    for spec in field_specs(cls):
        known = {**SIZES, **KEPT, "header": header}
        if spec.name in known:
            values[spec.name] = known[spec.name]
        elif spec.kind == "array" and set(spec.shape) <= set(SIZES):
            kind = PLAIN[spec.wire]
            number = float_ if np.issubdtype(kind, np.floating) else integer % 2**31
            number = integer if kind is np.int64 else number
            with np.errstate(over="ignore"):
                values[spec.name] = np.full([SIZES[n] for n in spec.shape], number, kind)
        elif spec.kind == "scalar":
            some = {"int64": integer, "double": float_, "bool": True, "string": "h264"}
            values[spec.name] = some.get(spec.wire, b"rubbish")
    return decode(cls, encode(cls(**values)))


@pytest.mark.parametrize(("integer", "float_"), list(itertools.product(INTEGERS, FLOATS)))
def test_extreme_numbers_leave_the_page_standing(integer, float_):
    site = Site(Wiring({DOOR: ["n"]}), lambda: START_NS)
    session = Session(site)
    session.ask(json.dumps({"feed": DOOR}))
    for _ in range(2):
        for topic, cls in TOPICS.items():
            key = KEYS.get(topic, f"rsenf/{DOOR}/{topic}")
            site.update(key, full_of(cls, integer, float_))
            told = session.news()
            assert not told or json.loads(told)["version"] == 1
        camera = Camera("door", grid_hz(60))
        for sent in (reference(grid_hz(60)), camera.rows(3), camera.enf(3), camera.live(3)):
            site.update(*sent)
    assert json.loads(session.news())["cards"][0]["live"]["verdict"] == "live"
    feed = site.feed(DOOR)
    assert feed is not None
    assert 0.1 < feed.strip.rms_level < 10


def test_a_link_out_of_the_archive_is_not_served(tmp_path: Path) -> None:
    archive, secret = tmp_path / "archive", tmp_path / "secret.mcap"
    secret.write_bytes(b"secret")
    path = new_path(archive, ArchivedCamera("house", "door"), START_NS)
    path.write_bytes(b"own")
    name = path.relative_to(archive).as_posix()
    assert file_named(archive, name) == path
    path.unlink()
    path.symlink_to(secret)
    assert file_named(archive, name) is None
    linked = tmp_path / "linked"
    linked.symlink_to(archive)  # the folder itself may be one
    path.unlink()
    path.write_bytes(b"own")
    assert file_named(linked, name) == linked / name
