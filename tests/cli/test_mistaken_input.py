"""Mistakes that a court would want named: `rsenf verify` says which, and claims nothing wrong."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]


def verify(rsenf: Rsenf, clip: Path, reference: Path, *words: object) -> dict[str, Any]:
    done = rsenf("verify", clip, "--reference", reference, *words, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def said(found: dict[str, Any]) -> str:
    return " / ".join([found["reason"], *found["warnings"]])


def edited(hidden: HiddenClip, path: Path, kept: np.ndarray | None, speed: float = 1.0) -> Path:
    """The hidden clip's rows, some frames left out, at another speed."""
    with np.load(hidden.clip) as held:
        rows, time_s = held["rows"], held["frame_time_s"]
    rows = rows if kept is None else rows[kept[: rows.shape[0]]]
    np.savez(path, rows=rows, frame_time_s=time_s[: rows.shape[0]] / speed)
    return path


def values_alone(hidden: HiddenClip, path: Path, away_hz: float = 0.0) -> Path:
    rows = hidden.reference.read_text().splitlines()[1:]
    path.write_text("\n".join(f"{float(row.split(',')[1]) + away_hz:.6f}" for row in rows))
    return path


def test_a_claim_in_another_time_zone(rsenf: Rsenf, hidden: HiddenClip) -> None:
    found = verify(rsenf, hidden.clip, hidden.reference, "--start", "2024-03-01T11:39:05.4Z")
    assert (found["decision"], found["claim"]) == ("match", "refuted")
    assert found["lag_s"] == pytest.approx(hidden.lag_s, abs=1)
    assert "off by just -1 h: a time zone or daylight saving?" in said(found)


def test_a_reference_in_another_time_zone(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    local = tmp_path / "local.csv"
    local.write_text(hidden.reference.read_text().replace("Z,", ","))
    words = ["--timezone", "Asia/Kolkata", "--start", hidden.start_utc]
    found = verify(rsenf, hidden.clip, local, *words)
    assert (found["decision"], found["claim"]) == ("match", "refuted")
    assert "off by just -5.5 h" in said(found)
    assert "outside of the reference, which lasts from 2024-03-01T04:30" in said(found)


def local_reference(hidden: HiddenClip, path: Path, hours: int = 1) -> Path:
    """The hidden clip's reference by a clock that is ahead of UTC and doesn't say so."""
    rows = [row.split("Z,") for row in hidden.reference.read_text().splitlines()[1:]]
    ahead = np.timedelta64(hours, "h")
    local = [f"{np.datetime64(t) + ahead},{f}" for t, f in rows]
    path.write_text("\n".join(["time,frequency", *local]) + "\n")
    return path


@pytest.mark.parametrize("later_s", [0, 3600])
def test_a_reference_that_tells_no_zone(
    rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path, later_s: int
) -> None:
    """An hour off may be the zone's fault: such a claim isn't refuted."""
    path = local_reference(hidden, tmp_path / "local.csv")
    start = str(np.datetime64(hidden.start_utc.removesuffix("Z")) + np.timedelta64(later_s, "s"))
    done = rsenf("verify", hidden.clip, "--reference", path, "--start", start)
    first = done.stdout.splitlines()[0]
    assert first.startswith("match: ")
    assert first.endswith("; zone unknown: by whole hours uncertain")
    found = verify(rsenf, hidden.clip, path, "--start", start)
    assert found["zone_unknown"]
    assert found["claim"] == ("supported" if later_s else "undecidable")
    assert "the reference's times tell no zone (--timezone)" in said(found)
    assert ("off by just +1 h" in said(found)) == (not later_s)


def test_what_is_no_whole_hours_away_is_refuted_without_a_zone(
    rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path
) -> None:
    path = local_reference(hidden, tmp_path / "local.csv")
    start = str(np.datetime64(hidden.start_utc.removesuffix("Z")) + np.timedelta64(900, "s"))
    assert verify(rsenf, hidden.clip, path, "--start", start)["claim"] == "refuted"


def test_a_night_of_daylight_saving_without_a_zone(
    rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path
) -> None:
    values = [row.split(",")[1] for row in hidden.reference.read_text().splitlines()[1:]]
    utc = np.datetime64("2024-03-31T00:00:00") + np.arange(len(values)).astype("timedelta64[s]")
    hours = 1 + (utc >= np.datetime64("2024-03-31T01:00:00"))
    path = tmp_path / "night.csv"
    local = utc + hours.astype("timedelta64[h]")
    path.write_text("time,Hz\n" + "".join(f"{t},{f}\n" for t, f in zip(local, values, strict=True)))
    done = rsenf("verify", hidden.clip, "--reference", path)
    assert done.returncode == 2
    assert "the hour from 2024-03-31 02:00 is skipped, as by daylight saving" in done.stderr
    assert "give --timezone" in done.stderr
    found = verify(rsenf, hidden.clip, path, "--timezone", "Europe/Berlin")
    assert found["lag_s"] == pytest.approx(hidden.lag_s, abs=1)
    assert not found["zone_unknown"]


def test_a_reference_as_a_spreadsheet_writes_it(
    rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path
) -> None:
    rows = [row.split("Z,") for row in hidden.reference.read_text().splitlines()[1:]]
    path = tmp_path / "sheet.csv"
    lines = [
        f"{np.datetime64(t).astype(object):%d/%m/%Y %H:%M:%S};{1e3 * (float(f) - 50):.2f}".replace(
            ".", ","
        )
        for t, f in rows
    ]
    path.write_text("\n".join(["sep=;", "Zeit;Abweichung [mHz]", *lines]) + "\n")
    words = ["--column", "Abweichung", "--timezone", "UTC"]
    done = rsenf("verify", hidden.clip, "--reference", path, *words)
    assert done.returncode == 2
    assert "may be day or month first: give --time-format '%d/%m/%Y %H:%M:%S'" in done.stderr
    words += ["--time-format", "%d/%m/%Y %H:%M:%S"]
    done = rsenf("verify", hidden.clip, "--reference", path, *words)
    assert "deviations in mHz from which frequency? Give --nominal-hz 50 or 60" in done.stderr
    found = verify(rsenf, hidden.clip, path, *words, "--nominal-hz", "50")
    assert found["start_utc"][:18] == hidden.start_utc[:18]
    assert "values are deviations in mHz from 50 Hz" in said(found)


def test_a_wrong_step(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    values = values_alone(hidden, tmp_path / "values.csv")
    found = verify(rsenf, hidden.clip, values, "--step-s", "2")
    assert found["decision"] == "no_decision"
    assert "with a step of 1 s instead of 2 s the reference would fit, 2345." in said(found)


def test_a_reference_of_another_grid(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    values = values_alone(hidden, tmp_path / "us.csv", away_hz=10.0)
    found = verify(rsenf, hidden.clip, values, "--step-s", "1")
    assert found["decision"] in ("no_decision", "no_match")
    assert "looked for a 60 Hz grid, as the reference's is" in said(found)


def test_a_clip_that_was_cut_and_rejoined(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    frame = np.arange(4000)
    kept = (frame < 1590) | (frame >= 2100)  # 17 s less, after 53 s
    clip = edited(hidden, tmp_path / "cut.npz", kept)
    found = verify(rsenf, clip, hidden.reference, "--start", hidden.start_utc)
    assert (found["decision"], found["claim"]) == ("no_decision", "undecidable")
    assert "s are missing: cut and rejoined?" in said(found)
    assert "fit from 2024-03-01T10:39:05" in said(found)


def test_a_cut_is_told_without_a_claim(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    rate_hz = 30000 / 1001
    frame = np.arange(round(102 * rate_hz))
    kept = (frame < 39 * rate_hz) | (frame >= 51 * rate_hz)
    clip = edited(hidden, tmp_path / "cut.npz", np.r_[kept, np.zeros(1000, bool)])
    report = tmp_path / "report"
    found = verify(rsenf, clip, hidden.reference, "--report", report)
    assert found["decision"] == "no_decision"
    assert "at 39 s of the clip 12.0 s are missing: cut and rejoined?" in said(found)
    (edit,) = found["edits"]
    assert (edit["kind"], round(edit["at_s"]), round(edit["size_s"])) == ("cut", 39, 12)
    first, second = found["segments"]
    assert first["start_utc"].startswith("2024-03-01T10:39:05")
    # From the first second on whose window bears no trace of the cut, at 10:39:56.
    assert "2024-03-01T10:39:55" < second["start_utc"] < "2024-03-01T10:40:05"
    page = (report / "report.html").read_text()
    assert "What seems to have been done to the recording" in page
    assert edit["text"].split(":")[0] in page
    assert (report / "timeline.png").stat().st_size > 5000


@pytest.mark.parametrize("speed", [1.01, 0.99])
def test_another_speed(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path, speed: float) -> None:
    clip = edited(hidden, tmp_path / "fast.npz", None, speed)
    found = verify(rsenf, clip, hidden.reference, "--start", hidden.start_utc)
    assert (found["decision"], found["claim"]) == ("match", "supported")
    assert found["lag_s"] == pytest.approx(hidden.lag_s, abs=0.1)
    (edit,) = found["edits"]
    assert edit["kind"] == "speed"
    assert edit["speed_ratio"] == pytest.approx(speed, abs=1e-4)
    assert "than it was filmed, or wrong frame times" in edit["text"]


def test_a_clip_that_was_coded_twice(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    once, twice = tmp_path / "once.mp4", tmp_path / "twice.mp4"
    done = rsenf(
        "simulate", "--out", once, "--reference", hidden.reference, "--start-s", "1234.5",
        "--duration-s", "70", "--size", "320x240", "--seed", "4", "--bitrate", "150k",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    code_again(once, twice, 100_000)
    found = verify(rsenf, twice, hidden.reference, "--start", "2024-03-01T10:20:34.5Z")
    assert found["decision"] in ("match", "no_decision")
    assert found["claim"] in ("supported", "undecidable")
    if found["decision"] == "match":
        assert found["lag_s"] == pytest.approx(1234.5, abs=1)


def code_again(source: Path, target: Path, bits: int) -> None:
    with av.open(str(source)) as read, av.open(str(target), "w") as written:
        (coded,) = read.streams.video
        stream = written.add_stream("libx264", rate=coded.average_rate)
        stream.width, stream.height, stream.pix_fmt = coded.width, coded.height, "yuv420p"
        stream.bit_rate, stream.time_base = bits, coded.time_base
        for frame in read.decode(coded):
            written.mux(stream.encode(frame))
        written.mux(stream.encode())
