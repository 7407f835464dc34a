"""Row means against one-pixel-at-a-time sums; the mask against a scene that moves."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages import Frame, Header, RowBlock, canonical
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows, blocks_from_luminance
from rsenf.rows.steady import CACHED_BYTES, SteadyMask, picture_part, tile_edges, tile_sums
from tests.oracle.row_means import row_means
from tests.oracle.steady_rows import SlowRows


def frame(number: int, luma: NDArray[np.uint8]) -> Frame:
    header = Header(
        source="t/c", seq=number, frame_first=number, frame_last=number, pts_ns=number * 33_366_667
    )
    return Frame(header=header, height_px=luma.shape[0], width_px=luma.shape[1], luma=luma)


def noise(seed: int, shape: tuple[int, int]) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(30, 220, shape, dtype=np.uint8)


@pytest.mark.parametrize("axis", ["rows", "columns"])
@pytest.mark.parametrize("shape", [(48, 64), (33, 854), (90, 1366)])
@pytest.mark.parametrize("strips", [1, 2, 8])
def test_row_means_equal_the_slow_ones(axis: str, shape: tuple[int, int], strips: int) -> None:
    padded = noise(1, (shape[0], shape[1] + 42))
    luma = padded[:, : shape[1]]  # a decoder's lines are padded
    stage = Rows(RowsSettings(read_out_axis=axis, strips=strips, mask=False, tile_means=True))
    assert stage.update(frame(0, luma)) == []
    (block,) = stage.flush()
    np.testing.assert_allclose(block.level[0], row_means(luma, axis, strips), rtol=1e-6)
    across = shape[1] if axis == "rows" else shape[0]
    assert (block.kept_px.sum(axis=1) == across).all()
    assert block.rows == (shape[0] if axis == "rows" else shape[1])


def test_rows_that_are_read_in_parts_add_up_to_the_same() -> None:
    luma = noise(4, (700, 853))
    assert luma.nbytes > CACHED_BYTES
    exact = np.add.reduceat(luma, tile_edges(853, 8)[:-1], axis=1, dtype=np.int64)
    np.testing.assert_array_equal(tile_sums(luma, "rows", 8), exact.T)


def flickering(count: int, *, box: bool, shape: tuple[int, int] = (128, 256)) -> list[Frame]:
    """A textured wall under flicker; a bright box may cross the right half from frame 40 on."""
    rng = np.random.default_rng(5)
    wall = rng.uniform(60, 140, shape)
    rows = np.arange(shape[0]) / shape[0]
    out = []
    for n in range(count):
        picture = wall.copy()
        if box and n >= 40:
            left = 140 + (n - 40) * 2
            picture[20:90, left : left + 40] = 200
        gain = 1 + 0.08 * np.cos(2 * np.pi * (100 / 29.97 * n + 2.1 * rows))
        levels = picture * gain[:, None] + rng.normal(0, 1.5, shape)
        out.append(frame(n, np.clip(np.rint(levels), 0, 255).astype(np.uint8)))
    return out


def blocks(frames: list[Frame], settings: RowsSettings) -> list[RowBlock]:
    stage = Rows(settings)
    return [b for f in frames for b in stage.update(f)] + stage.flush()


def test_still_scene_keeps_every_pixel_and_the_mask_changes_nothing() -> None:
    frames = flickering(64, box=False)
    masked = blocks(frames, RowsSettings())
    assert all(b.steady_ratio == 1.0 and b.usable for b in masked)
    plain = blocks(frames, RowsSettings(mask=False))
    for a, b in zip(masked, plain, strict=True):
        np.testing.assert_allclose(a.level, b.level, rtol=1e-6)


def test_moving_box_is_left_out_and_the_rows_stay_where_they_were() -> None:
    still, moving = flickering(88, box=False), flickering(88, box=True)
    truth = np.concatenate([b.level for b in blocks(still, RowsSettings(mask=False))])[48:]
    plain = np.concatenate([b.level for b in blocks(moving, RowsSettings(mask=False))])[48:]
    masked_blocks = blocks(moving, RowsSettings())
    masked = np.concatenate([b.level for b in masked_blocks])[48:]
    assert all(b.steady_ratio < 1 for b in masked_blocks[6:])
    assert all(b.kept_px.sum() < 128 * 256 for b in masked_blocks[6:])
    error_plain, error_masked = (np.sqrt(np.mean((x - truth) ** 2)) for x in (plain, masked))
    assert error_plain > 5.0
    assert error_masked < 0.1 * error_plain


@pytest.mark.parametrize("strips", [2, 8])
@pytest.mark.parametrize("axis", ["rows", "columns"])
@pytest.mark.parametrize(
    ("shape", "padded"), [((128, 256), 0), ((128, 256), 64), ((70, 250), 6)]
)  # whole tiles in a row of memory; padding after each row; tiles that differ by a pixel
def test_same_bits_as_the_obvious_way(
    axis: str, shape: tuple[int, int], padded: int, strips: int
) -> None:
    slow, frames = SlowRows(axis, strips), flickering(96, box=True, shape=shape)
    stage = Rows(RowsSettings(read_out_axis=axis, strips=strips))
    moved = 0
    for first in range(0, len(frames), 8):
        planes = [np.pad(f.luma, ((0, 0), (0, padded))) for f in frames[first : first + 8]]
        cut = [p[:, : shape[1]] for p in planes]
        sent = [b for n, luma in enumerate(cut) for b in stage.update(frame(first + n, luma))]
        level, kept = slow.update(cut)
        np.testing.assert_array_equal(sent[0].level, level)
        np.testing.assert_array_equal(sent[0].kept_px, kept)
        moved += sent[0].steady_ratio < 1
    assert moved > 3


def test_blocks_are_cut_at_frame_numbers_however_they_arrive() -> None:
    frames = flickering(30, box=False)
    whole = blocks(frames, RowsSettings())
    assert [(b.header.seq, b.header.frame_first, b.header.frame_last) for b in whole] == [
        (0, 0, 7), (1, 8, 15), (2, 16, 23), (3, 24, 29),
    ]  # fmt: skip
    # A node that joined at frame 13 numbers its blocks as one that saw everything would.
    late = blocks(frames[13:], RowsSettings())
    assert [(b.header.seq, b.header.frame_first) for b in late] == [(1, 13), (2, 16), (3, 24)]
    again = blocks(frames, RowsSettings())
    assert [canonical(b) for b in again] == [canonical(b) for b in whole]


def test_frames_that_never_came_are_seen_in_the_numbers() -> None:
    frames = [f for f in flickering(24, box=False) if f.header.seq not in (5, 8, 9, 10, 11)]
    got = blocks(frames, RowsSettings())
    assert [list(b.frame_number) for b in got] == [
        [0, 1, 2, 3, 4, 6, 7], [12, 13, 14, 15], [16, 17, 18, 19, 20, 21, 22, 23],
    ]  # fmt: skip


def test_black_and_white_pictures_are_not_usable() -> None:
    for level in (16, 255):
        luma = np.full((64, 64), level, np.uint8)
        got = blocks([frame(n, luma) for n in range(8)], RowsSettings())
        assert not got[0].usable
        assert "black or white" in got[0].reason


def test_planes_are_not_kept() -> None:
    """The plane may be a view of memory that is used again: blocks must not look at it later."""
    luma = noise(3, (32, 64))
    expected = row_means(luma, "rows", 8)
    stage = Rows()
    stage.update(frame(0, luma))
    luma[:] = 0
    (block,) = stage.flush()
    np.testing.assert_allclose(block.level[0], expected, rtol=1e-6)


@pytest.mark.parametrize(("axis", "shape"), [("rows", (64, 7)), ("columns", (7, 64))])
def test_a_picture_narrower_than_its_tiles_is_one_strip(axis: str, shape: tuple[int, int]) -> None:
    luma = noise(6, shape)
    (block,) = blocks([frame(0, luma)], RowsSettings(read_out_axis=axis, tile_means=True))
    assert (block.strips, block.tiles) == (1, 1)
    across = luma.mean(axis=1 if axis == "rows" else 0)
    np.testing.assert_allclose(block.level[0, :, 0], across, rtol=1e-6)
    assert (block.kept_px == 7).all()


def test_settings_that_do_not_fit() -> None:
    with pytest.raises(UsageError, match="strips"):
        RowsSettings(strips=3)
    with pytest.raises(UsageError, match="read_out_axis"):
        RowsSettings(read_out_axis="diagonal")


def test_luminance_arrays_become_the_same_blocks() -> None:
    frames = flickering(21, box=False)
    ours = blocks(frames, RowsSettings(mask=False))
    level = np.concatenate([b.level for b in ours])
    times = np.concatenate([b.frame_pts_ns for b in ours]) / 1e9
    again = list(blocks_from_luminance(level, times, Header(source="t/c")))
    for a, b in zip(ours, again, strict=True):
        np.testing.assert_array_equal(a.level, b.level)
        np.testing.assert_array_equal(a.frame_pts_ns, b.frame_pts_ns)
        np.testing.assert_array_equal(a.frame_number, b.frame_number)
        assert a.header.seq == b.header.seq


def test_band_means() -> None:
    mask = SteadyMask(tiles=2, rows=50)
    level = np.random.default_rng(0).random((3, 2, 50)).astype(np.float32)
    edges = [0, 16, 33, 50]
    slow = np.stack([level[..., a:b].mean(axis=2) for a, b in itertools.pairwise(edges)], 2)
    np.testing.assert_allclose(mask.band_means(level), slow, rtol=1e-5)


def test_bars_are_cut_off_and_the_rows_are_those_of_the_film() -> None:
    """Letterbox, pillarbox and both."""
    film = flickering(24, box=False)
    plain = blocks(film, RowsSettings(strips=2))
    for above, beside in ((32, 0), (0, 48), (13, 21)):
        boxed = []
        for number, one in enumerate(film):
            assert one.luma is not None
            pads = [(above, above + above % 2), (beside, beside + beside % 2)]
            boxed.append(frame(number, np.pad(one.luma, pads, constant_values=16)))
        for seen, true in zip(blocks(boxed, RowsSettings(strips=2)), plain, strict=True):
            np.testing.assert_allclose(seen.level, true.level, atol=1e-3)


@pytest.mark.parametrize("quality", [90, 50, 20])
@pytest.mark.parametrize("above", [12, 21, 30])
def test_a_codec_does_not_move_the_edges_of_bars(quality: int, above: int) -> None:
    """JPEG blurs an edge within its block of eight lines: a line too many is 0.4 % idle."""
    (film,) = flickering(1, box=False, shape=(240, 320))
    assert film.luma is not None
    boxed = np.pad(film.luma, [(above, above), (0, 0)], constant_values=16)
    coded = cv2.imencode(".jpg", boxed, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    rows, columns = picture_part(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE))
    assert (rows, columns) == (slice(above, above + 240), slice(0, 320))


def test_what_is_no_pair_of_bars_stays() -> None:
    picture = np.full((64, 96), 90, np.uint8)
    picture += noise(6, picture.shape) // 8
    whole = slice(0, 64), slice(0, 96)
    dark = np.pad(picture[16:-16], [(16, 16), (0, 0)], constant_values=16)
    assert picture_part(dark) == (slice(16, 48), slice(0, 96))
    noisy = dark + np.random.default_rng(1).integers(0, 9, dark.shape, dtype=np.uint8)
    slanting = dark.copy()
    slanting[16:40, :60] = 16  # a dark roof over more than half of the picture
    one_sided = np.pad(picture[16:], [(16, 0), (0, 0)], constant_values=16)
    for no_bars in (picture, noisy, slanting, one_sided, np.full_like(picture, 16)):
        assert picture_part(no_bars) == whole
