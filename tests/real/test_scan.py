"""A folder is scanned: what is said of each file, and what is kept of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsenf
from tests.flicker import no_mains, weak_lamps
from tests.real import scan


def test_a_folder_is_told_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, page, kept = (tmp_path / name for name in ("films", "page", "kept"))
    folder.mkdir()
    level, t_s, truth = weak_lamps.film(2, flicker_ratio=0.02, lamps=1, pace=(50.0, "24"))
    np.savez(folder / "lamp.npz", rows=level, frame_time_s=t_s)
    level, t_s = no_mains.film("stripes", 3)
    np.savez(folder / "stripes.npz", rows=level, frame_time_s=t_s)
    (folder / "notes.txt").write_text("no film")
    words = [folder, "--out", page, "--keep", kept, "--about", "a test camera"]
    scan.main([str(word) for word in words])
    told = [line.split(" | ") for line in capsys.readouterr().out.splitlines()]
    claims = {(name, method): claim for name, method, claim, *_ in told}
    percent, std = (float(x) for x in claims["lamp.npz", "idle coherent"][5:-2].split(" ± "))
    assert abs(percent - 100 * truth["idle_ratio"]) < 4 * std + 1e-3
    assert claims["lamp.npz", "track projection"].startswith("ENF ")
    assert claims["stripes.npz", "track projection"] == "nothing"
    assert claims["notes.txt", "–"] == "can't be read"
    assert (page / "lamp.npz.png").exists()
    assert "a pattern" in (page / "index.html").read_text() or "stripes" in str(told)
    again = np.load(kept / "lamp.npz")
    assert "a test camera" in str(again["about"])
    assert rsenf.read_recording(kept / "lamp.npz").rows.shape == again["rows"].shape
