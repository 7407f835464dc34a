"""A topic becomes a table that loses nothing, and the light a sound of the right pitch."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import scipy.io.wavfile
from record_samples import ROWS, Clock, header, random_message, rows

from rsenf.cli import main
from rsenf.errors import InputError, UsageError
from rsenf.messages import EnfEstimate, IdleEstimate, Mark, RowBlock
from rsenf.messages.schema import field_specs, message_classes
from rsenf.record import Recorder, open_recording
from rsenf.record.export import RecordedLight, Selection, write_sound, write_table
from rsenf.record.export.table import MessageColumns

TRACK = "rsenf/site/cam/track"
IDLE = "rsenf/site/cam/idle"


def record(path: Path, messages) -> Path:
    with Recorder(path, run_info={}, clock_ns=Clock()) as recorder:
        for topic, message in messages:
            recorder.write(topic, message)
    return path


def parquet_lines(path):
    return pyarrow.parquet.read_table(path).to_pylist()


def test_columns_of_every_class_have_names_of_their_own():
    for cls in message_classes().values():
        if field_specs(cls)[0].name == "header":
            names = MessageColumns("t", cls).schema.names
            assert len(names) == len(set(names)), cls
            assert {"schema", "log_time_ns", "epoch", "seq", "pts_ns"} < set(names)


def test_every_class_becomes_a_table(tmp_path):
    for cls in message_classes().values():
        if field_specs(cls)[0].name != "header" or cls in (RowBlock,):
            continue
        made = [random_message(cls, seed, header(seq)) for seq, seed in enumerate((3, 4))]
        path = record(tmp_path / "a.mcap", [("rsenf/s/c/x", m) for m in made])
        recording = open_recording(path)
        messages = [message for _, message, _ in recording.messages()]
        assert write_table(recording, "rsenf/s/c/x", tmp_path / "x.parquet") == 2
        assert write_table(recording, "rsenf/s/c/x", tmp_path / "x.csv") == 2
        lines = parquet_lines(tmp_path / "x.parquet")
        with open(tmp_path / "x.csv", newline="") as stream:
            texts = list(csv.DictReader(stream))
        for line, text, message in zip(lines, texts, messages, strict=True):
            assert line["schema"] == f"rsenf.{cls.__name__}/{cls.VERSION}"
            assert (line["seq"], line["pts_ns"]) == (message.header.seq, message.header.pts_ns)
            assert list(text) == list(line)
            for spec in field_specs(cls):
                value = getattr(message, spec.name)
                if spec.kind == "array":
                    expected = [None if v != v else v for v in np.ravel(value).tolist()]
                    assert line[spec.name] == expected
                    assert json.loads(text[spec.name]) == expected
                elif spec.kind == "scalar" and spec.wire == "double":
                    assert line[spec.name] == float(text[spec.name]) == value
                elif spec.kind == "scalar" and spec.wire != "bytes":
                    assert line[spec.name] == value
        (tmp_path / "a.mcap").unlink()


def test_unknown_is_empty_and_marks_are_left_out(tmp_path):
    messages = [
        (TRACK, EnfEstimate(header=header(0), enf_hz=50.01, enf_var_hz2=1e-9)),
        (TRACK, EnfEstimate(header=header(1), reason="no signal")),
        (TRACK, EnfEstimate(header=header(2, mark=Mark.END))),
    ]
    recording = open_recording(record(tmp_path / "a.mcap", messages))
    assert write_table(recording, TRACK, tmp_path / "x.parquet") == 2
    first, second = parquet_lines(tmp_path / "x.parquet")
    assert (first["enf_hz"], second["enf_hz"], second["reason"]) == (50.01, None, "no signal")
    write_table(recording, TRACK, tmp_path / "x.csv")
    with open(tmp_path / "x.csv", newline="") as stream:
        assert [line["enf_hz"] for line in csv.DictReader(stream)] == ["50.01", ""]


def test_rows_are_a_line_a_frame(tmp_path):
    blocks = [rows(number) for number in range(3)]
    recording = open_recording(record(tmp_path / "a.mcap", [(ROWS, b) for b in blocks]))
    for name in ("x.parquet", "x.csv"):
        assert write_table(recording, ROWS, tmp_path / name) == 6
    table = pyarrow.parquet.read_table(tmp_path / "x.parquet")
    luma = [name for name in table.column_names if name.startswith("luma_levels_")]
    assert luma[:3] == [f"luma_levels_row000{r}_strip{s}" for r, s in ((0, 0), (0, 1), (1, 0))]
    levels = np.array([table.column(name).to_numpy() for name in luma]).T
    assert np.array_equal(levels, np.concatenate([b.level for b in blocks]).reshape(6, -1))
    assert table.column("frame_number").to_pylist() == list(range(6))
    with open(tmp_path / "x.csv", newline="") as stream:
        text = [[float(line[name]) for name in luma] for line in csv.DictReader(stream)]
    assert np.array_equal(np.array(text, np.float32), levels)


def test_rows_that_change_their_number_are_refused(tmp_path):
    blocks = [rows(0), rows(0, n_rows=8, epoch=1)]
    recording = open_recording(record(tmp_path / "a.mcap", [(ROWS, b) for b in blocks]))
    with pytest.raises(InputError, match="rows change from 6 × 2 strips to 8 × 2"):
        write_table(recording, ROWS, tmp_path / "x.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    assert write_table(recording, ROWS, tmp_path / "x.csv", Selection(epoch=1)) == 2


def test_a_damaged_chunk_costs_lines_and_is_said(tmp_path, capsys):
    path = record(tmp_path / "a.mcap", [(ROWS, rows(n)) for n in range(3)])
    content = bytearray(path.read_bytes())
    content[200 + content.index(b"zstd")] ^= 0xFF
    path.write_bytes(content)
    code = main(["export", str(path), "--topic", "rows", "--out", str(tmp_path / "x.csv")])
    assert code in (1, 3)
    assert "rsenf: " in capsys.readouterr().err


# --- sound ---------------------------------------------------------------------------------------

FRAME_RATE_HZ, IDLE_RATIO, N_ROWS, TONE_HZ = 29.97, 0.38, 240, 100.02


def filmed(seconds=20.0, missing=(), upwards=False, axis="rows", n_rows=N_ROWS, run_id="run"):
    """Row blocks of a textured wall under a lamp at a known frequency, by the rows' own times."""
    scene = np.random.default_rng(1).normal(110, 25, n_rows)
    for seq, first in enumerate(range(0, int(seconds * FRAME_RATE_HZ), 8)):
        numbers = np.array([n for n in range(first, first + 8) if n not in missing], np.int64)
        if not numbers.size:
            continue
        row_s = np.arange(n_rows) / n_rows * (1 - IDLE_RATIO) / FRAME_RATE_HZ
        time_s = numbers[:, None] / FRAME_RATE_HZ + (row_s[::-1] if upwards else row_s)
        level = scene + 6 * np.cos(2 * np.pi * TONE_HZ * time_s)
        yield RowBlock(
            header=header(seq, run_id=run_id),
            read_out_axis=axis,
            frames=numbers.size,
            rows=n_rows,
            strips=1,
            frame_number=numbers,
            frame_pts_ns=np.rint(numbers / FRAME_RATE_HZ * 1e9).astype(np.int64),
            level=level[:, :, None].astype(np.float32),
            kept_px=np.ones((n_rows, 1), np.uint32),
        )


def strongest_hz(rate_hz, signal):
    """Strongest tone below 300 Hz, to a few mHz."""
    step = rate_hz // 1000
    slow = np.asarray(signal, float)[: len(signal) // step * step].reshape(-1, step).mean(axis=1)
    spectrum = np.abs(np.fft.rfft(slow * np.hanning(len(slow)), 1 << 19))
    tones_hz = np.arange(spectrum.size) * rate_hz / step / (1 << 19)
    return tones_hz[np.argmax(spectrum[tones_hz < 300])]


@pytest.mark.parametrize("sample_format", ["float32", "pcm16"])
@pytest.mark.parametrize("upwards", [False, True])
def test_the_light_is_heard_at_its_pitch(tmp_path, sample_format, upwards):
    blocks = list(filmed(upwards=upwards))
    sound = write_sound(
        lambda: blocks,
        tmp_path / "x.wav",
        idle_ratio=IDLE_RATIO,
        upwards=upwards,
        sample_format=sample_format,
    )
    rate_hz, signal = scipy.io.wavfile.read(tmp_path / "x.wav")
    assert rate_hz == sound.rate_hz == round(N_ROWS * FRAME_RATE_HZ / (1 - IDLE_RATIO))
    assert len(signal) == sound.samples
    assert len(signal) / rate_hz == pytest.approx(20, abs=0.3)
    unit = np.iinfo(np.int16).max if sample_format == "pcm16" else 1.0
    signal = signal / unit
    assert np.max(np.abs(signal)) <= 1.0
    assert strongest_hz(rate_hz, signal) == pytest.approx(TONE_HZ, abs=0.005)
    # Back to levels by the factor in the file: what the lamp does where rows were read.
    levels = signal[: 2 * rate_hz] * sound.levels_per_unit
    time_s = np.arange(len(levels)) / rate_hz
    read = (time_s * FRAME_RATE_HZ) % 1 < 0.98 * (1 - IDLE_RATIO)
    truth = 6 * np.cos(2 * np.pi * TONE_HZ * time_s)
    assert np.max(np.abs(levels - truth)[read]) < 0.1


def test_a_sound_that_takes_the_idle_period_for_nothing_is_out_of_tune(tmp_path):
    """The test above can fail."""
    blocks = list(filmed())
    write_sound(lambda: blocks, tmp_path / "x.wav", idle_ratio=0.0)
    rate_hz, signal = scipy.io.wavfile.read(tmp_path / "x.wav")
    assert abs(strongest_hz(rate_hz, signal) - TONE_HZ) > 0.1


def test_the_factor_is_in_the_file(tmp_path):
    blocks = list(filmed(5))
    sound = write_sound(
        lambda: blocks, tmp_path / "x.wav", idle_ratio=IDLE_RATIO, about={"topic": ROWS}
    )
    content = (tmp_path / "x.wav").read_bytes()
    start = content.index(b"ICMT") + 8
    note = json.loads(content[start : content.index(b"\0", start)])
    assert note["levels_per_unit"] == sound.levels_per_unit == pytest.approx(6, abs=0.3)
    assert (note["topic"], note["rows"], note["idle_ratio"]) == (ROWS, N_ROWS, IDLE_RATIO)


def test_missing_frames_are_silent_and_take_their_time(tmp_path):
    blocks = list(filmed(missing=range(150, 210)))
    sound = write_sound(lambda: blocks, tmp_path / "x.wav", idle_ratio=IDLE_RATIO)
    rate_hz, signal = scipy.io.wavfile.read(tmp_path / "x.wav")
    assert sound.frame_rate_hz == pytest.approx(FRAME_RATE_HZ)
    gap = signal[math.ceil(150 / FRAME_RATE_HZ * rate_hz) : int(209.9 / FRAME_RATE_HZ * rate_hz)]
    assert len(gap) > 1.9 * rate_hz
    assert np.max(np.abs(gap)) == 0
    assert strongest_hz(rate_hz, signal) == pytest.approx(TONE_HZ, abs=0.02)


@pytest.mark.parametrize("missing", ["every third", "a tenth"])
def test_frames_that_are_missing_without_a_number_don_t_change_the_pitch(tmp_path, missing):
    frames = range(int(20 * FRAME_RATE_HZ))
    tenth = np.random.default_rng(3).choice(frames, len(frames) // 10, replace=False)
    lost = frames[2::3] if missing == "every third" else {int(n) for n in tenth}
    blocks = list(renumbered(filmed(missing=lost)))
    sound = write_sound(lambda: blocks, tmp_path / "x.wav", idle_ratio=IDLE_RATIO)
    rate_hz, signal = scipy.io.wavfile.read(tmp_path / "x.wav")
    assert sound.frame_rate_hz == pytest.approx(FRAME_RATE_HZ, rel=1e-6)
    assert strongest_hz(rate_hz, signal) == pytest.approx(TONE_HZ, abs=0.02)
    assert np.mean(signal == 0) > 0.05


def renumbered(blocks):
    """The blocks of a source that knows nothing of the frames it lacks."""
    count = itertools.count()
    for block in blocks:
        numbers = np.array([next(count) for _ in block.frame_number], np.int64)
        yield dataclasses.replace(block, frame_number=numbers)


def test_frame_means_are_a_sound_at_the_frame_rate(tmp_path):
    blocks = list(filmed(axis="frame", n_rows=1))
    recording = open_recording(record(tmp_path / "a.mcap", [(ROWS, b) for b in blocks]))
    light = RecordedLight(recording, ROWS, Selection())
    assert write_sound(light.blocks, tmp_path / "x.wav", idle_ratio=light.idle_ratio).rate_hz == 30


def test_the_idle_period_comes_from_the_recording(tmp_path, capsys):
    known = IdleEstimate(
        header=header(0), verdict="estimated", idle_ratio=IDLE_RATIO, direction="reverse"
    )
    blocks = [(ROWS, b) for b in filmed(5, upwards=True)]
    path = record(tmp_path / "a.mcap", [*blocks, (IDLE, known)])
    assert main(["export", str(path), "--out", str(tmp_path / "x.wav"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["idle_ratio"], said["lost"]) == (IDLE_RATIO, "")
    rate_hz, signal = scipy.io.wavfile.read(tmp_path / "x.wav")
    assert strongest_hz(rate_hz, signal) == pytest.approx(TONE_HZ, abs=0.01)
    without = str(record(tmp_path / "b.mcap", blocks))
    assert main(["export", without, "--out", str(tmp_path / "y.wav")]) == 2
    assert "--idle-ratio" in capsys.readouterr().err
    assert not (tmp_path / "y.wav").exists()
    assert main(["export", without, "--out", str(tmp_path / "y.wav"), "--idle-ratio", "0.3"]) == 0


def test_several_epochs_are_not_one_sound(tmp_path):
    blocks = [rows(0, pts_ns=0), rows(0, epoch=1)]
    recording = open_recording(record(tmp_path / "a.mcap", [(ROWS, b) for b in blocks]))
    with pytest.raises(UsageError, match="epoch 0 of run 'run', epoch 1 of run 'run'"):
        RecordedLight(recording, ROWS, Selection())
    assert len(list(RecordedLight(recording, ROWS, Selection(epoch=1)).blocks())) == 1


def test_several_runs_are_not_one_sound(tmp_path, capsys):
    blocks = [*filmed(5), *filmed(5, run_id="a01")]
    path = str(record(tmp_path / "a.mcap", [(ROWS, b) for b in blocks]))
    words = ["export", path, "--out", str(tmp_path / "x.wav"), "--idle-ratio", "0.38", "--json"]
    assert main(words) == 2
    assert "epoch 0 of run 'run', epoch 0 of run 'a01'" in capsys.readouterr().err
    assert main([*words, "--run", "a0"]) == 0
    assert json.loads(capsys.readouterr().out)["duration_s"] == pytest.approx(5, abs=0.1)
    table = ["export", path, "--topic", "rows", "--out", str(tmp_path / "x.csv"), "--json"]
    assert main([*table, "--run", "a01"]) == 0
    assert json.loads(capsys.readouterr().out)["lines"] == 19 * 8


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "x.txt"], "no telling what to write"),
        (["--out", "x.csv", "--topic", "match"], "no topic 'match'"),
        (["--out", "x.csv", "--topic", "rows"], "several topics 'rows'"),
        (["--out", "x.csv", "--topic", "rows", "--camera", "roof"], "of a camera 'roof'"),
        (["--out", "x.wav", "--topic", "track"], "no light that could be heard"),
        (["--out", "x.wav", "--camera", "cam", "--idle-ratio", "1.5"], "an idle ratio of 1.5"),
        (["--out", "no/such/x.csv"], "can't write"),
    ],
)
def test_what_cannot_be_meant_is_said_in_a_line(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    track = (TRACK, EnfEstimate(header=header(0)))
    other = ("rsenf/site/yard/rows", rows(0))
    record(tmp_path / "a.mcap", [(ROWS, rows(0)), (ROWS, rows(1)), other, track])
    assert main(["export", "a.mcap", *words]) in (1, 2)
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
