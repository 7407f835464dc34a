"""Detects repeated and blended frames by the noise of pictures, without any light.

Model: two pictures of a sensor always differ by the same amount of noise. A converter to a higher
frame rate repeats some pictures, which don't differ at all; one that blends neighbours reduces the
noise, most where it mixes them evenly, and neighbours that share a source picture differ by less.
Either follows the beat between the two rates, which nothing else does.

Statistic: the share of the variation of the mean square differences between pictures that each
usual conversion explains.

Approximate: codecs and motion change these differences as well, which counts as chance.

References
----------
- Wang, W. and Farid, H. (2007), Exposing digital forgeries in video by detecting duplication, Proc.
  9th ACM Workshop on Multimedia and Security, 35.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.rate_conversion import OFF_RATIO, RATES_HZ, Conversion, round_rate

Float = NDArray[np.float64]

LAGS = (1, 2)  # frames between the pictures that are compared
ORDER = 4  # of the difference from row to row, which suppresses flicker below the noise
BLENDED_PLACES, DOUBLED_PLACES = 24, 240  # beat phases tried
LEAST_LEVEL = 1.0  # floor of the level when rows are scaled to constant brightness
SAME = 1e-3  # relative difference below which places are equally good: short beats have many
SAME_RATIO = 3e-4  # rates that differ by less beat too slowly
# Relative variance of a mean square of n differences, times n: neighbours share rows.
CHANCE = 5.3
# Least share of the variation beyond chance that a conversion has to explain, and least rms
# variation: codecs cause changes as well.
MIN_EXPLAINED, MIN_CHANGE = 0.6, 0.05
# Beats as slow as changes of level and gain have to explain more.
SLOW_RATIO, MIN_OF_SLOW = 3e-3, 0.85
MOST = 4.0  # times the median: larger differences are cuts or key frames


class PictureChange:
    """Measures how much each picture differs from those just before, in a stream of rows."""

    def __init__(self) -> None:
        self._last: NDArray[np.float32] | None = None
        self._first: NDArray[np.float32] | None = None  # levels of the first picture
        self.chance = 0.0  # relative variance of the results by noise alone

    def of(self, level: NDArray[np.floating]) -> Float:
        """Return the mean square differences from the pictures before, shape (frames, lags).

        Parameters
        ----------
        level : ndarray, shape (frames, rows, strips)
        """
        if level.shape[1] <= ORDER:  # too few rows to tell
            return np.zeros((len(level), len(LAGS)))
        # Residual texture beats with the flicker's alias, as conversions do, unless each row is
        # scaled to constant brightness.
        level = np.asarray(level, np.float32)
        bright = np.maximum(level[:, ORDER // 2 : -ORDER // 2], np.float32(LEAST_LEVEL))
        if self._first is None or self._first.shape != bright.shape[1:]:
            self._first = bright[0].copy()
        sharp = np.diff(level, ORDER, axis=1)
        sharp *= self._first / bright
        before, self.chance = max(LAGS), CHANCE / max(sharp[0].size, 1)
        if self._last is None or self._last.shape[1:] != sharp.shape[1:]:
            self._last = np.repeat(sharp[:1], before, axis=0)
        all_of = np.concatenate([self._last, sharp])
        self._last = all_of[-before:]
        differ = [
            (all_of[before:] - all_of[before - lag : -lag]).reshape(len(sharp), -1) for lag in LAGS
        ]
        return np.stack([np.einsum("fn,fn->f", d, d) / d.shape[1] for d in differ], axis=1)


def find_remade(stamp_s: Float, news: Float, shown_hz: float, chance: float) -> Conversion | None:
    """Find how pictures were repeated or blended, if they were (Wang and Farid 2007).

    Parameters
    ----------
    stamp_s : ndarray, shape (frames,)
        Time stamps since the stream's first frame.
    news : ndarray, shape (frames, lags)
        As of :meth:`PictureChange.of`.
    shown_hz : float
        Frame rate by the stamps.
    chance : float
        Relative variance of ``news`` by noise alone.
    """
    shown_hz = round_rate(shown_hz)
    usual = np.median(news, axis=0)
    valid = np.diff(stamp_s, prepend=-np.inf) * shown_hz < 1.5
    valid[: max(LAGS)] = False
    if valid.sum() < 8 or not usual.min() > 0.0:
        return None
    change = np.minimum(news[valid] / usual, MOST)
    change -= change.mean(axis=0)
    power = float(np.sum(change**2)) - chance * change.size
    if power < max(MIN_CHANGE**2, chance) * change.size:
        return None
    best, found = 0.0, None
    for source_hz, blended in _tried(shown_hz):
        places = np.arange(BLENDED_PLACES if blended else DOUBLED_PLACES)
        first = Conversion(source_hz, shown_hz, 0.0).source_frames(stamp_s[None])
        like = _expected(first + (places / places.size)[:, None], blended=blended)[:, valid]
        like -= like.mean(axis=1, keepdims=True)
        size, both = np.sum(like**2, axis=(1, 2)), np.sum(like * change, axis=(1, 2))
        explained = np.maximum(both, 0.0) ** 2 / (np.where(size > 0.0, size, 1.0) * power)
        top = float(explained.max())
        beat = abs(source_hz / shown_hz - max(round(source_hz / shown_hz), 1))
        if top > max(MIN_OF_SLOW if beat < SLOW_RATIO else MIN_EXPLAINED, best):
            place = _middle(explained > (1.0 - SAME) * top) / places.size
            best, found = top, Conversion(source_hz, shown_hz, place, blended)
    return found


def _tried(shown_hz: float) -> Iterator[tuple[float, bool]]:
    """Yield source rates, and whether pictures are blended."""
    for source_hz in RATES_HZ:
        if abs(source_hz / shown_hz - 1.0) < SAME_RATIO:
            continue
        if source_hz < shown_hz:
            yield source_hz, False
        for off in OFF_RATIO:
            yield source_hz * (1.0 + off), True


def _middle(same: NDArray[np.bool_]) -> float:
    """Middle of the run of equally good places on the circle."""
    first = int(same.argmin())  # outside the run; any place if all are equal
    turned = np.flatnonzero(np.roll(same, -first))
    row = turned[: int(np.argmax(np.append(np.diff(turned), 2) > 1)) + 1]
    return float((row.mean() + first) % same.size)


def _expected(source: Float, *, blended: bool) -> Float:
    """Expected mean square differences of pictures made of a source's frames.

    Shape (places, frames, lags) for frames of shape (places, frames).
    """
    whole = np.floor(source)
    share = source - whole if blended else np.zeros(source.shape)
    out = np.zeros((*source.shape, len(LAGS)))
    for column, lag in enumerate(LAGS):
        apart = np.full(source.shape, 9.0)
        apart[:, lag:] = whole[:, lag:] - whole[:, :-lag]
        before = np.concatenate([share[:, :lag], share[:, :-lag]], axis=1)
        # Weights 1 − s and s of a frame and the next: both pictures' noise, less what they share.
        alone = (1 - share) ** 2 + share**2 + (1 - before) ** 2 + before**2
        common = (apart == 0) * ((1 - share) * (1 - before) + share * before)
        common += (apart == 1) * (1 - share) * before
        out[..., column] = alone - 2.0 * common
    return out
