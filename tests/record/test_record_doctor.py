"""The doctor says what is in a recording, what is wrong with it, and what to do."""

from __future__ import annotations

import json

import pytest
from record_samples import ROWS, VIDEO, Clock, rows, sample_file

from rsenf.cli import main
from rsenf.messages import RowBlock
from rsenf.record import Recorder


@pytest.fixture
def path(tmp_path):
    sample_file(tmp_path / "a.mcap")
    return tmp_path / "a.mcap"


def doctor(capsys, *words):
    code = main(["doctor", *map(str, words)])
    return code, capsys.readouterr()


def test_a_whole_recording(path, capsys):
    code, said = doctor(capsys, path, "--json")
    [found] = json.loads(said.out)
    assert (code, found["verdict"], found["problems"], found["messages"]) == (0, "whole", [], 72)
    topics = {topic["topic"]: topic for topic in found["topics"]}
    assert topics.keys() == {ROWS, VIDEO}
    assert topics[ROWS]["messages"] == 36
    assert topics[ROWS]["schema_version"] == topics[VIDEO]["schema_version"] == "1"
    assert topics[ROWS]["first_utc"] == "2026-09-21T14:13:20.000Z"
    assert (topics[ROWS]["gaps"], topics[ROWS]["lost_at_end"]) == ([], 0)
    code, said = doctor(capsys, path)
    assert code == 0
    assert said.out.startswith(f"{path}: whole. 72 messages")
    assert "wrong" not in said.out


def test_damage_is_named_by_topic_and_number(path, capsys, tmp_path):
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)
    code, said = doctor(capsys, path)
    assert code == 3
    assert f"rsenf recover {path} --out NEW.mcap" in said.out
    assert "lost: " in said.out
    code, said = doctor(capsys, path, "--json")
    [found] = json.loads(said.out)
    assert [gap["cause"] for topic in found["topics"] for gap in topic["gaps"]] == ["damage"] * 2
    assert main(["recover", str(path), "--out", str(tmp_path / "new.mcap")]) == 3
    assert "lost: " in capsys.readouterr().out
    code, said = doctor(capsys, tmp_path / "new.mcap")
    assert code == 0
    assert "missing: " in said.out
    assert main(["recover", str(tmp_path / "new.mcap"), "--in-place", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["lost"] == {}


def test_a_recording_that_breaks_off(path, capsys):
    path.write_bytes(path.read_bytes()[:12_000])
    code, said = doctor(capsys, path)
    assert code == 3
    assert "it breaks off" in said.out
    assert "what came after " in said.out


def test_messages_that_never_came_are_no_damage(tmp_path, capsys):
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        for seq in (3, 4, 8):
            recorder.write(ROWS, rows(seq))
    code, said = doctor(capsys, tmp_path / "a.mcap")
    assert code == 0
    assert "3 missing: 5–7" in said.out


def test_another_version_of_a_schema(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(RowBlock, "VERSION", 99)
    with Recorder(tmp_path / "a.mcap", run_info={}, clock_ns=Clock()) as recorder:
        recorder.write(ROWS, rows(0))
    monkeypatch.undo()
    code, said = doctor(capsys, tmp_path / "a.mcap")
    assert code == 3
    assert "1 messages can't be read" in said.out
    assert "read them with rsenf" in said.out


def test_files_of_no_use(path, capsys, tmp_path):
    text = tmp_path / "text.mcap"
    text.write_bytes(b"It was a dark night.")
    code, said = doctor(capsys, path, text, "--json")
    assert code == 1
    assert [found["verdict"] for found in json.loads(said.out)] == ["whole", "unusable"]
    assert "not an MCAP recording" in said.err
    code, said = doctor(capsys, tmp_path / "none.mcap")
    assert code == 2
    assert "no such file" in said.err


def test_a_recording_in_the_making_is_whole_so_far(tmp_path, capsys):
    path = tmp_path / "a.mcap"
    with Recorder(path, run_info={}, clock_ns=Clock()) as recorder:
        recorder.write(ROWS, rows(0))
        recorder.flush()
        code, said = doctor(capsys, path)
        assert code == 0
        assert said.out.startswith(f"{path}: whole so far, it is being recorded. 1 messages")
        assert "wrong" not in said.out
        assert main(["recover", str(path), "--out", str(tmp_path / "new.mcap")]) == 0
    assert doctor(capsys, path, tmp_path / "new.mcap")[0] == 0
    (tmp_path / "killed.mcap").write_bytes(path.read_bytes()[:-50])
    assert doctor(capsys, tmp_path / "killed.mcap")[0] == 3


def test_a_file_that_isn_t_there_costs_no_other(path, capsys, tmp_path):
    code, said = doctor(capsys, tmp_path / "none.mcap", path, "--json")
    assert code == 2
    assert [found["verdict"] for found in json.loads(said.out)] == ["unusable", "whole"]
    assert "none.mcap" in said.err
