"""The picture's spectrogram against a slow sum over the very same series."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.messages import Header, RowBlock
from rsenf.report.picture import KEPT_ROWS, MAX_COLUMNS, ThinRows
from rsenf.rows.stage import blocks_from_luminance

RATE_HZ, ROWS = 30000 / 1001, 128
IDLE_RATIO = 0.38


def filmed(seconds: float, light_hz: float, amplitude: float) -> tuple[NDArray, NDArray]:
    """Rows of a rolling shutter under a light of one frequency, on a textured wall."""
    time_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    line_s = (1 - IDLE_RATIO) / RATE_HZ / ROWS
    row_time_s = time_s[:, None] + np.arange(ROWS) * line_s
    texture = 100 + 30 * np.sin(np.arange(ROWS) / 7)
    level = texture + amplitude * np.cos(2 * np.pi * light_hz * row_time_s + 0.3)
    return level[:, :, None], time_s


def blocks(level: NDArray, time_s: NDArray) -> Iterator[RowBlock]:
    return blocks_from_luminance(level, time_s, Header(source="test/cam1"))


def spectrum_of(level: NDArray, time_s: NDArray) -> ThinRows:
    rows = ThinRows()
    for block in blocks(level, time_s):
        rows.add(block)
    return rows


def slow_level_db(series: NDArray, f_hz: float, rate_hz: float) -> float:
    """Level of one frequency under a Hann window, term by term."""
    total, weights = 0j, 0.0
    for k, value in enumerate(series):
        weight = 0.5 - 0.5 * np.cos(2 * np.pi * k / (len(series) - 1))
        total += weight * value * np.exp(-2j * np.pi * f_hz * k / rate_hz)
        weights += weight
    return float(10 * np.log10(abs(2 * total / weights) ** 2 + 1e-9))


def test_lines_of_known_light_are_where_and_as_strong_as_a_slow_sum_has_them() -> None:
    level, time_s = filmed(24.0, 100.02, 5.0)
    t_s, f_hz, level_db = spectrum_of(level, time_s).spectrogram()
    # The window that the first column stands for, averaged down row by row.
    window = round(2 * t_s[0] * RATE_HZ)
    thin = level[:window, :, 0].reshape(window, KEPT_ROWS, -1).mean(axis=2)
    series = (thin - thin.mean(axis=0)).reshape(-1)
    for m in (-1, 1, 2, 3):  # the paper's lines, f_0 − m·F_r
        line_hz = 100.02 - m * RATE_HZ
        nearest = int(np.argmin(abs(f_hz - line_hz)))
        near = slice(nearest - 3, nearest + 4)
        peak = near.start + int(np.argmax(level_db[near, 0]))
        assert abs(f_hz[peak] - line_hz) <= f_hz[1]
        slow = slow_level_db(series, f_hz[peak], RATE_HZ * KEPT_ROWS)
        assert level_db[peak, 0] == pytest.approx(slow, abs=0.01)
    assert f_hz[-1] == pytest.approx(RATE_HZ * KEPT_ROWS / 2, abs=f_hz[1])


def test_without_idle_time_a_light_is_one_line_of_its_own_frequency() -> None:
    frames, rate_hz = 600, 30.0
    at = np.arange(frames * ROWS) / (rate_hz * ROWS)
    level = (100 + 2.0 * np.cos(2 * np.pi * 104.0 * at)).reshape(frames, ROWS, 1)
    _, f_hz, level_db = spectrum_of(level, np.arange(frames) / rate_hz).spectrogram()
    assert f_hz[int(np.argmax(level_db[:, 0]))] == pytest.approx(104.0, abs=f_hz[1])
    # 2 levels, less what averaging 1/16 of a frame takes from 104 Hz.
    share = np.sinc(104.0 / (rate_hz * KEPT_ROWS))
    assert level_db.max() == pytest.approx(20 * np.log10(2.0 * share), abs=1.5)


def test_frame_means_reach_to_half_the_frame_rate() -> None:
    time_s = np.arange(900) / RATE_HZ
    level = 100 + np.cos(2 * np.pi * 100.0 * time_s)
    rows = spectrum_of(level[:, None, None], time_s)
    _, f_hz, level_db = rows.spectrogram()
    assert f_hz[-1] == pytest.approx(RATE_HZ / 2, abs=f_hz[1])
    alias_hz = 100.0 - 3 * RATE_HZ
    assert f_hz[int(np.argmax(level_db[:, 0]))] == pytest.approx(alias_hz, abs=f_hz[1])
    assert rows.seen_hz(100.0) == pytest.approx(alias_hz)
    assert rows.kept_rows == 1


@pytest.mark.parametrize("frames", [2, 10, 200])
def test_a_clip_shorter_than_a_window_is_one_column(frames: int) -> None:
    level, time_s = filmed(60.0, 100.0, 5.0)
    t_s, f_hz, level_db = spectrum_of(level[:frames], time_s[:frames]).spectrogram()
    assert level_db.shape == (f_hz.size, 1)
    assert t_s == pytest.approx([frames / 2 / RATE_HZ])
    assert np.isfinite(level_db).all()


@pytest.mark.parametrize("frames", [0, 1])
def test_a_single_frame_has_no_spectrum(frames: int) -> None:
    rows = ThinRows()
    for block in blocks(np.ones((frames, 4, 1)), np.arange(frames) / 30):
        rows.add(block)
    with pytest.raises(ValueError, match="fewer than two frames"):
        rows.spectrogram()


def test_times_are_the_windows_centres() -> None:
    """A light that is switched on after a minute shows from then on, give or take a window."""
    level, time_s = filmed(120.0, 100.0, 5.0)
    level[time_s < 60.0] = level.mean(axis=0)
    t_s, _, level_db = spectrum_of(level, time_s).spectrogram()
    line = int(np.argmax(level_db[:, -1]))
    lit = level_db[line] > level_db[line].max() - 6.0
    assert not lit[t_s < 60.0].any()
    assert lit[t_s > 65.0].all()
    assert np.allclose(np.diff(t_s), 2.0, atol=0.1)


def test_blocks_of_another_size_are_left_out() -> None:
    level, time_s = filmed(12.0, 100.0, 5.0)
    rows = spectrum_of(level, time_s)
    before = rows.spectrogram()
    for block in blocks(np.ones((8, 7, 1)), 12.0 + np.arange(8) / 30):
        rows.add(block)
    for was, now in zip(before, rows.spectrogram(), strict=True):
        assert np.array_equal(was, now)


def test_hours_take_no_more_room_than_minutes() -> None:
    """Two hours: columns are merged on the way, and their times stay right."""
    rows, frame = ThinRows(), 0
    part = filmed(60.0, 100.0, 5.0)[0].astype(np.float32)[:, ::8]
    tracemalloc.start()
    peaks = []
    for minute in range(120):
        time_s = (frame + np.arange(len(part))) / RATE_HZ
        for block in blocks(part, time_s):
            rows.add(block)
        frame += len(part)
        if minute in (60, 119):
            peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    t_s, _, level_db = rows.spectrogram()
    assert level_db.shape[1] < MAX_COLUMNS
    assert t_s[-1] == pytest.approx(frame / RATE_HZ, abs=60.0)
    assert peaks[1] < 1.05 * peaks[0]
    assert peaks[1] < 50e6
