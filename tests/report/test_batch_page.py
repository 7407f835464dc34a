"""The page of a batch: whole in itself, a file's name is never markup, and headings sort."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path
from typing import Any

import pytest

from rsenf.batch.columns import ANALYSES, make_row
from rsenf.batch.run import table_rows
from rsenf.batch.settings import RecordingFile
from rsenf.report.batch_page import batch_page
from tests.dashboard.browser import Browser, chromium
from tests.report.html_page import Page

FIGURES = {"idle_ratio": 0.25, "idle_ratio_std": 0.0012, "verdict": "estimated"}


def row(name: str, status: str = "done", **more: Any) -> dict[str, Any]:
    recording = RecordingFile(f"/videos/{name}", f"/videos/{name}", 10, 10**18)
    return make_row(recording, "idle", "settings", status, "", **more)


def page_of(*rows: dict[str, Any], analysis: str = "idle") -> str:
    return batch_page(analysis, table_rows(analysis, rows), {"reference": "<grid>.csv"})


def test_names_are_texts() -> None:
    text = page_of(row("<script>alert(1)</script>.mp4", **FIGURES), row("in/b\udcff.mp4", "failed"))
    page = Page(text)
    assert "<script>alert(1)</script>.mp4" in page.words
    assert "<grid>.csv" in page.words
    assert "in/b\\udcff.mp4" in page.words
    assert "25.00 ± 0.12" in page.words
    assert page.words.startswith("rsenf batch idle: 2 recordings")
    assert len(page.all("script")) == 1


def test_only_its_own_script_runs() -> None:
    text = page_of(row("a.mp4", **FIGURES))
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.S)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = (m["content"] for m in Page(text).all("meta") if "http-equiv" in m)
    assert policy == (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'"
    )


@pytest.mark.parametrize("analysis", ANALYSES)
def test_a_recording_of_which_nothing_is_known(analysis: str) -> None:
    recording = RecordingFile("/a.mp4", "/a.mp4", -1, -1)
    failed = make_row(recording, analysis, "settings", "failed", "it broke")
    assert "it broke" in Page(page_of(failed, analysis=analysis)).words


@pytest.mark.external
def test_a_heading_sorts(tmp_path: Path) -> None:
    if not chromium():
        pytest.skip("no Chromium here")
    ratios = {"b.mp4": 0.1, "a10.mp4": None, "a9.mp4": 0.25, "c.mp4": 0.07}
    rows = [row(name, **{**FIGURES, "idle_ratio": ratio}) for name, ratio in ratios.items()]
    (tmp_path / "batch.html").write_text(page_of(*rows), encoding="utf-8")
    with Browser() as browser:
        browser.open((tmp_path / "batch.html").as_uri())
        browser.until("document.querySelector('th button')")

        def sorted_by(heading: str) -> list[str]:
            buttons = "[...document.querySelectorAll('th button')]"
            browser.value(f"{buttons}.find(b => b.innerText == '{heading}').click()")
            names = "[...document.querySelectorAll('tbody')[0].rows].map(r => r.cells[0].innerText)"
            return list(browser.value(names))

        assert sorted_by("idle (%)") == ["c.mp4", "b.mp4", "a9.mp4", "a10.mp4"]
        assert sorted_by("idle (%)") == ["a9.mp4", "b.mp4", "c.mp4", "a10.mp4"]
        assert sorted_by("recording") == ["a9.mp4", "a10.mp4", "b.mp4", "c.mp4"]
        assert browser.complaints == []
