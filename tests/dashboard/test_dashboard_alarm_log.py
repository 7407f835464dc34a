"""The log of alarms: nothing that was said to be kept is lost, whatever happens to the file."""

from __future__ import annotations

import json
import resource
import signal
import tracemalloc

import pytest
from messages_of import START_NS, Camera, grid_hz

from rsenf.dashboard.app import Session
from rsenf.dashboard.site import Site, Wiring
from rsenf.record.archive import alarms
from rsenf.record.archive.alarms import NAME, AlarmLog

START_MS = 1_768_435_200_000
ALARM = {"feed": "lab/cam1", "kind": "frozen", "active": True, "start_ms": START_MS}
ALARM |= {"end_ms": START_MS + 2000, "ack": None}
SEEN = {**ALARM, "ack": {"by": "Ann", "note": "looked", "at_ms": 1_768_435_260_000}}


def kept(folder):
    """Acknowledgement of each alarm, by its identity, as a later process reads it."""
    return {alarm["id"]: alarm["ack"] for alarm in AlarmLog(folder).day("")["alarms"]}


@pytest.fixture
def limited_file():
    """Limit the size of files, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    yield lambda size_bytes: resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    signal.signal(signal.SIGXFSZ, handler)


def test_a_line_after_one_that_was_cut_off_is_kept(tmp_path):
    AlarmLog(tmp_path).note("a", ALARM)
    with (tmp_path / NAME).open("a") as file:
        file.write('{"id": "x", "start_')
    AlarmLog(tmp_path).note("b", SEEN)
    assert kept(tmp_path) == {"a": None, "b": SEEN["ack"]}


def test_a_line_that_was_written_in_part_is_an_error(tmp_path, limited_file):
    log = AlarmLog(tmp_path)
    log.note("a", ALARM)
    size_bytes = (tmp_path / NAME).stat().st_size
    limited_file(size_bytes + 50)
    with pytest.raises(OSError, match="No space left"):
        log.acknowledge("a", SEEN)
    limited_file(resource.getrlimit(resource.RLIMIT_FSIZE)[1])
    assert (tmp_path / NAME).stat().st_size == size_bytes + 50
    assert log.acknowledgement("a") is None
    log.acknowledge("a", SEEN)
    assert kept(tmp_path) == {"a": SEEN["ack"]}


def damaged(**changed):
    return json.dumps({"version": 1, "id": "a", **SEEN, **changed})


@pytest.mark.parametrize(
    "line",
    ["[" * 100_000, "[]", "7", damaged(id=["a"]), damaged(id=7), damaged(version=2),
     damaged(end_ms=float("nan")), damaged(end_ms=10**400), damaged(start_ms="now"),
     damaged(ack={"by": 7, "note": []}), damaged(ack={"by": "Ann"}), damaged(ack=["Ann"]),
     damaged(feed=[]), damaged(kind=None)],
)  # fmt: skip
def test_a_damaged_line_is_skipped(tmp_path, line):
    AlarmLog(tmp_path).note("a", ALARM)
    with (tmp_path / NAME).open("a") as file:
        file.write(f"{line}\n")
    AlarmLog(tmp_path).note("b", SEEN)
    assert kept(tmp_path) == {"a": None, "b": SEEN["ack"]}
    assert AlarmLog(tmp_path).acknowledgement("a") is None


@pytest.mark.parametrize("later", ["the alarm again", "another alarm", "its end", "the end"])
def test_what_can_not_be_written_is_told_and_written_later(tmp_path, later):
    camera, folder = Camera("door", grid_hz(60)), tmp_path / "archive"
    folder.write_text("a file in the folder's place")
    with Site(Wiring(archive=folder), lambda: START_NS) as site:
        site.update(*camera.alarm(0, 7))
        told = json.loads(Session(site).news())["alarms"]
        assert told["unwritten"].startswith(f"{folder}: file exists; ")
        (alarm,) = site.alarms.log.day("")["alarms"]
        assert alarm["kind"] == "phase_jump"
        folder.unlink()
        if later != "the end":
            second, more = (9, {"kind": "loop"}) if later == "another alarm" else (7, {})
            site.update(*camera.alarm(1, second, active=later != "its end", **more))
            assert json.loads(Session(site).news())["alarms"]["unwritten"] == ""
    found = AlarmLog(folder).day("")["alarms"]
    assert [a["kind"] for a in found] == ["loop", "phase_jump"][later != "another alarm" :]
    assert found[-1]["active"] is (later != "its end")


@pytest.mark.parametrize("later", [0, 500])
def test_an_alarm_that_is_noted_again_stays_acknowledged(tmp_path, later):
    log = AlarmLog(tmp_path)
    log.acknowledge("old", SEEN)
    for number in range(later):
        log.acknowledge(f"later {number}", SEEN)
    assert log.acknowledgement("old") == SEEN["ack"]
    assert AlarmLog(tmp_path).acknowledgement("old") == SEEN["ack"]
    log.note("other", {**SEEN, "start_ms": 0})
    for _ in range(2):
        log.note("other", {**ALARM, "start_ms": 0})
    (other,) = AlarmLog(tmp_path).day("1970-01-01")["alarms"]
    assert other["ack"] == SEEN["ack"]


def test_of_a_long_file_the_end_is_read_in_bounded_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(alarms, "READ_BYTES", 20_000)
    log = AlarmLog(tmp_path)
    for number in range(5000):
        log.note(f"alarm {number}", SEEN)
    assert (tmp_path / NAME).stat().st_size > 20 * alarms.READ_BYTES
    tracemalloc.start()
    found = AlarmLog(tmp_path).day("")
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    numbers = sorted(int(alarm["id"].split()[1]) for alarm in found["alarms"])
    assert numbers == list(range(numbers[0], 5000))
    assert len(numbers) > 50
    assert peak_bytes < 20 * alarms.READ_BYTES
