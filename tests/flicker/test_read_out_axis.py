"""The read-out axis is told by the flicker's ramp, and by nothing else that changes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.flicker.acquire import find_axis
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance

HEIGHT, WIDTH = 90, 160
SECONDS = 12.0

Picture = NDArray[np.float64]


def told(pictures: Picture, time_s: Picture) -> str:
    """What is told of pictures (frames, height, width)."""
    noise = np.random.default_rng(1)
    shown = np.rint(pictures + noise.normal(0.0, 2.0, pictures.shape))
    rows, columns = (
        list(blocks_from_luminance(shown.mean(axis=axis)[:, :, None], time_s, Header()))
        for axis in (2, 1)
    )
    return find_axis(rows, columns)


def scene() -> Picture:
    """A wall brighter to the right and to the top, with a dark cupboard."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    wall = 80.0 + 60.0 * x / WIDTH - 30.0 * y / HEIGHT
    wall[40:, 20:60] *= 0.4
    return np.asarray(wall)


def filmed(
    axis: str, rate_hz: float, enf_hz: float = 50.017, *, read_out: float = 0.7, ratio: float = 0.05
) -> tuple[Picture, Picture]:
    """Pictures under flicker, read out in a share of the frame; negative: backwards."""
    time_s = np.arange(int(SECONDS * rate_hz)) / rate_hz
    lines = HEIGHT if axis == "rows" else WIDTH
    at_s = time_s[:, None] + np.arange(lines) / lines * read_out / rate_hz
    light = 1.0 + ratio * np.cos(4 * np.pi * enf_hz * at_s)
    light = light[:, :, None] if axis == "rows" else light[:, None, :]
    return scene() * light, time_s


@pytest.mark.parametrize("axis", ["rows", "columns"])
@pytest.mark.parametrize(
    ("rate_hz", "enf_hz"),
    [(24000 / 1001, 50.017), (25.0, 50.017), (25.0, 60.01), (30000 / 1001, 49.98), (30.0, 60.02),
     (50.0, 49.98), (60.0, 50.0), (120.0, 50.0)],
)  # fmt: skip
def test_by_its_ramp(axis: str, rate_hz: float, enf_hz: float) -> None:
    assert told(*filmed(axis, rate_hz, enf_hz)) == axis


@pytest.mark.parametrize("axis", ["rows", "columns"])
def test_read_out_backwards(axis: str) -> None:
    assert told(*filmed(axis, 30000 / 1001, read_out=-0.9)) == axis


@pytest.mark.parametrize("rate_hz", [25.0, 30000 / 1001])
def test_a_global_shutter_has_none(rate_hz: float) -> None:
    assert told(*filmed("rows", rate_hz, read_out=0.0)) == ""


@pytest.mark.parametrize("rate_hz", [25.0, 30000 / 1001])
def test_no_flicker_has_none(rate_hz: float) -> None:
    assert told(*filmed("columns", rate_hz, ratio=0.0)) == ""


def test_a_wall_that_brightens_has_none() -> None:
    pictures, time_s = filmed("columns", 25.0, ratio=0.0)
    exposure = 1.0 + 0.2 * np.sin(2 * np.pi * time_s / 9.0)
    assert told(pictures * exposure[:, None, None], time_s) == ""


def test_a_light_beside_the_picture_that_blinks_at_the_flicker_s_alias_has_none() -> None:
    pictures, time_s = filmed("columns", 30000 / 1001, ratio=0.0)
    falls_off = np.exp(-np.arange(WIDTH) / 50.0)
    blinks = 0.1 * np.cos(2 * np.pi * 10.11 * time_s)
    assert told(pictures * (1.0 + blinks[:, None, None] * falls_off), time_s) == ""


def test_two_frames_or_fewer_tell_nothing() -> None:
    pictures, time_s = filmed("columns", 30.0)
    assert told(pictures[:1], time_s[:1]) == ""
    assert find_axis([], []) == ""


@pytest.mark.parametrize("rate_hz", [1e-6, 1e-3, 1.0, 1e4, 1e6, 1e9])
def test_frames_of_no_camera_show_no_ramp(rate_hz: float) -> None:
    level = np.random.default_rng(3).normal(100.0, 1.0, (12, 16, 1)).astype(np.float32)
    (block,) = blocks_from_luminance(level, np.arange(12) / rate_hz, Header(), block_frames=12)
    assert find_axis([block], [block]) == ""
