"""Rows of a picture that moves as a whole, beside the light that was on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rsenf.messages import Frame, Header, RowBlock
from rsenf.rows import stabilise
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows

Float = NDArray[np.float64]
ROWS, ACROSS, FRAMES, FRAME_RATE_HZ = 120, 160, 240, 29.7
DEPTH = 0.04
Place = Callable[[int], tuple[int, int]]


def light(frame: int) -> Float:
    row_s = (frame + 0.8 * np.arange(ROWS) / ROWS) / FRAME_RATE_HZ
    return np.asarray(1.0 + DEPTH * np.cos(2.0 * np.pi * 100.0 * row_s))


def scene(seed: int) -> Float:
    grain = np.random.default_rng(seed).normal(size=(2, ROWS + 200, ACROSS + 400))
    return np.asarray(100.0 * np.exp(4.0 * gaussian_filter(grain[0], 8) + 0.1 * grain[1]))


def pictures(place: Place, wall: Float, seed: int = 1) -> Iterator[NDArray[np.uint8]]:
    rng = np.random.default_rng(seed)
    for frame in range(FRAMES):
        down, across = place(frame)
        shown = wall[down : down + ROWS, across : across + ACROSS] * light(frame)[:, None]
        shown += 2.0 * rng.standard_normal(shown.shape)
        yield np.rint(np.clip(shown, 0, 255)).astype(np.uint8)


def shaken(frame: int) -> tuple[int, int]:
    t_s = frame / FRAME_RATE_HZ
    return int(30 + 10 * np.sin(3.1 * t_s) + 4 * np.sin(11 * t_s)), int(30 + 12 * np.sin(2.3 * t_s))


def panned(frame: int) -> tuple[int, int]:
    return int(30 + 6 * np.sin(0.2 * frame)), frame


def sampled(settings: RowsSettings, shown: Iterator[NDArray[np.uint8]]) -> Float:
    """Row means over all strips, shape (frames, rows)."""
    rows, blocks = Rows(settings), []
    for number, luma in enumerate(shown):
        pts_ns = round(1e9 * number / FRAME_RATE_HZ)
        turned = luma.T.copy() if settings.read_out_axis == "columns" else luma
        header = Header(source="hand", frame_first=number, frame_last=number, pts_ns=pts_ns)
        blocks += rows.update(Frame(header=header, luma=turned))
    blocks += rows.flush()
    assert all(isinstance(block, RowBlock) for block in blocks)
    return np.concatenate([block.level for block in blocks]).mean(axis=2).astype(np.float64)


def error(level: Float, first: int) -> float:
    """Rms of what isn't light, over the light's, from a frame on; slow changes left out."""
    true = np.stack([light(frame) for frame in range(first, len(level))])
    change = level[first:] / level[first:].mean(axis=0) - true
    change -= gaussian_filter(change, (12.0, 0.0))
    return float(np.std(change) / np.std(true))


@pytest.mark.parametrize("axis", ["rows", "columns"])
@pytest.mark.parametrize("place", [shaken, panned])
def test_rows_show_the_light_alone(place: Place, axis: str) -> None:
    def of(*, stabilise: bool) -> float:
        settings = RowsSettings(read_out_axis=axis, stabilise=stabilise)  # type: ignore[arg-type]
        return error(sampled(settings, pictures(place, scene(2))), 60)

    assert of(stabilise=True) < min(0.25 * of(stabilise=False), 0.15)


@pytest.mark.parametrize("blank_frames", [0, 20])
def test_another_scene_is_followed_anew(blank_frames: int) -> None:
    def cut() -> Iterator[NDArray[np.uint8]]:
        both = zip(pictures(shaken, scene(3)), pictures(shaken, scene(4)[::-1]), strict=True)
        for frame, (first, second) in enumerate(both):
            after = frame - FRAMES // 2
            yield first if after < 0 else 0 * first if after < blank_frames else second

    assert error(sampled(RowsSettings(), cut()), FRAMES // 2 + 30) < 0.15


def test_a_camera_at_rest_is_left_alone() -> None:
    """Whatever walks past it."""

    def passed() -> Iterator[NDArray[np.uint8]]:
        for frame, luma in enumerate(pictures(lambda _: (30, 30), scene(5))):
            luma[30:100, frame // 2 : frame // 2 + 50] = 60
            yield luma

    at_rest = sampled(RowsSettings(stabilise=False), passed())
    assert np.array_equal(sampled(RowsSettings(), passed()), at_rest)


@pytest.mark.parametrize("seed", range(4))
def test_noise_on_a_few_pixels_is_no_motion(seed: int) -> None:
    def noise() -> Iterator[NDArray[np.uint8]]:
        for luma in pictures(lambda _: (0, 0), np.full((ROWS, ACROSS), 120.0), seed):
            yield luma[:24, :32]

    at_rest = sampled(RowsSettings(stabilise=False), noise())
    assert np.array_equal(sampled(RowsSettings(), noise()), at_rest)


def test_a_camera_that_rests_again_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stabilise, "REST_FRAMES", 60)
    wall = scene(6)

    def of(*, stabilise: bool) -> Float:
        once = pictures(lambda frame: shaken(min(frame, 90)), wall)
        return sampled(RowsSettings(stabilise=stabilise, mask=False), once)

    at_rest, followed = of(stabilise=False), of(stabilise=True)
    assert np.array_equal(followed[180:], at_rest[180:])
    assert error(followed[:150], 30) < 0.15


@pytest.mark.parametrize("shape", [(64, 1), (1, 64), (3, 3)])
def test_pictures_too_small_to_move_are_left_alone(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (100, *shape), np.uint8)
    at_rest = sampled(RowsSettings(stabilise=False), iter(noise))
    assert np.array_equal(sampled(RowsSettings(), iter(noise)), at_rest)
