"""What a video file says of itself."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from rsenf.decode.file import container_facts
from tests.decode.decode_clips import cut_short, make_clip, make_sound, pictures

SAID = {"creation_time": "2026-01-15T08:00:00Z", "make": "Acme", "com.android.model": "Eye 3"}
MS = Fraction(1, 1000)


def test_times_rate_and_maker(tmp_path: Path) -> None:
    """A frame that comes late shows, and makers' names count whatever they are called."""
    path = make_clip(
        tmp_path / "a.mov", list(pictures(5)), ticks=[0, 40, 80, 180, 220], time_base=MS,
        container_options={"movflags": "use_metadata_tags"}, metadata=SAID,
    )  # fmt: skip
    found = container_facts(path)
    assert found is not None
    assert (found.format, found.codec.split()[0]) == ("QuickTime / MOV", "h264")
    assert (found.width_px, found.height_px) == tuple(reversed(pictures(1)[0].shape))
    assert (found.rate_basis, found.stamped_frames) == ("", 5)
    gaps_s = (found.shortest_s, found.median_s, found.longest_s)
    assert gaps_s == pytest.approx((0.04, 0.04, 0.1), abs=1e-4)
    assert found.creation_time.startswith("2026-01-15T08:00:00")
    assert (found.make, found.model) == ("Acme", "Eye 3")
    assert found.encoder.startswith("Lavf")


def test_a_rate_alone(tmp_path: Path) -> None:
    found = container_facts(make_clip(tmp_path / "a.avi", list(pictures(5)), "mjpeg"))
    assert found is not None
    assert (found.rate_basis, found.stamped_frames, found.median_s) == ("declared", 0, None)
    assert found.declared_rate_hz == pytest.approx(30000 / 1001)
    assert (found.make, found.model, found.creation_time) == ("", "", "")


def test_a_file_that_is_cut_short(tmp_path: Path) -> None:
    whole = make_clip(tmp_path / "a.mkv", list(pictures(20)))
    found = container_facts(cut_short(whole, tmp_path / "b.mkv"))
    assert found is not None
    assert 1 < found.stamped_frames < 20


def test_what_is_no_video(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", luminance=np.zeros(9), frame_rate_hz=30.0)
    assert container_facts(tmp_path / "a.npz") is None
    assert container_facts(make_sound(tmp_path / "a.m4a")) is None
