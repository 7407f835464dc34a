"""How new each picture is, by its noise: what tells doubled and blended frames without any light.

Two pictures that a sensor takes differ by noise, always as much. A converter to a higher frame rate
shows some pictures twice, that don't differ at all; one that blends neighbours shows less noise the
more evenly it mixes them, and neighbours that have a picture in common differ by less. Either
follows the beat between the two rates, which nothing else does. So what pictures differ by is
compared with what each usual conversion would make of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.rate_conversion import OFF_RATIO, RATES_HZ, Conversion, round_rate

Float = NDArray[np.float64]

LAGS = (1, 2)  # frames between the pictures that are compared
ORDER = 4  # of the difference from row to row, in which flicker is nothing beside noise
BLENDED_PLACES, DOUBLED_PLACES = 24, 240  # of the beat that are tried
LEAST_LEVEL = 1.0  # of a row that is brought to another brightness
SAME = 1e-3  # share by which places are no better than others: where the beat is short
SAME_RATIO = 3e-4  # rates that differ by less beat too slowly
# Variance of a mean square of so many differences times their number: neighbours share rows.
CHANCE = 5.3
# Share of what changes, beyond chance, that doubled or blended frames have to explain, and how much
# there has to be of it: codecs make changes of their own.
MIN_EXPLAINED, MIN_CHANGE = 0.6, 0.05
# And where they beat as slowly as levels and gains change.
SLOW_RATIO, MIN_OF_SLOW = 3e-3, 0.85
MOST = 4.0  # times the median: what differs by more is a cut, or a key frame


class PictureChange:
    """By how much each picture differs from those just before, in a stream of rows."""

    def __init__(self) -> None:
        self._last: NDArray[np.float32] | None = None
        self._first: NDArray[np.float32] | None = None  # levels of the first picture
        self.chance = 0.0  # variance of what comes out, relative to its square, by chance alone

    def of(self, level: NDArray[np.floating]) -> Float:
        """Take pictures in; return the mean squares by which they differ, shape (frames, lags).

        Parameters
        ----------
        level : ndarray, shape (frames, rows, strips)
        """
        if level.shape[1] <= ORDER:  # too few rows to tell
            return np.zeros((len(level), len(LAGS)))
        # What is left of a texture beats with the flicker's alias, as conversions beat, unless
        # each row is brought to the same brightness.
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
    """Find how pictures were doubled or blended to give their rate, if they were.

    Parameters
    ----------
    stamp_s : ndarray, shape (frames,)
        Since the stream's first frame.
    news : ndarray, shape (frames, lags)
    shown_hz : float
        Frame rate by the stamps.
    chance : float
        Variance of news, relative to their square, by chance alone.
    """
    shown_hz = round_rate(shown_hz)
    usual = np.median(news, axis=0)
    own = np.diff(stamp_s, prepend=-np.inf) * shown_hz < 1.5
    own[: max(LAGS)] = False
    if own.sum() < 8 or not usual.min() > 0.0:
        return None
    seen = np.minimum(news[own] / usual, MOST)
    seen -= seen.mean(axis=0)
    power = float(np.sum(seen**2)) - chance * seen.size
    if power < max(MIN_CHANGE**2, chance) * seen.size:
        return None
    best, found = 0.0, None
    for source_hz, blended in _tried(shown_hz):
        places = np.arange(BLENDED_PLACES if blended else DOUBLED_PLACES)
        first = Conversion(source_hz, shown_hz, 0.0).source_frames(stamp_s[None])
        like = _expected(first + (places / places.size)[:, None], blended=blended)[:, own]
        like -= like.mean(axis=1, keepdims=True)
        size, both = np.sum(like**2, axis=(1, 2)), np.sum(like * seen, axis=(1, 2))
        explained = np.maximum(both, 0.0) ** 2 / (np.where(size > 0.0, size, 1.0) * power)
        top = float(explained.max())
        beat = abs(source_hz / shown_hz - max(round(source_hz / shown_hz), 1))
        if top > max(MIN_OF_SLOW if beat < SLOW_RATIO else MIN_EXPLAINED, best):
            place = _middle(explained > (1.0 - SAME) * top) / places.size
            best, found = top, Conversion(source_hz, shown_hz, place, blended)
    return found


def _tried(shown_hz: float) -> Iterator[tuple[float, bool]]:
    """Rates, and whether pictures are blended."""
    for source_hz in RATES_HZ:
        if abs(source_hz / shown_hz - 1.0) < SAME_RATIO:
            continue
        if source_hz < shown_hz:
            yield source_hz, False
        for off in OFF_RATIO:
            yield source_hz * (1.0 + off), True


def _middle(same: NDArray[np.bool_]) -> float:
    """Middle of those places round the circle that are the same, and in a row."""
    first = int(same.argmin())  # one that isn't; where all are, any will do
    turned = np.flatnonzero(np.roll(same, -first))
    row = turned[: int(np.argmax(np.append(np.diff(turned), 2) > 1)) + 1]
    return float((row.mean() + first) % same.size)


def _expected(source: Float, *, blended: bool) -> Float:
    """Mean squares by which pictures differ, of those that come from a source's frames.

    Of shape (places, frames, lags) for frames of shape (places, frames).
    """
    whole = np.floor(source)
    share = source - whole if blended else np.zeros(source.shape)
    out = np.zeros((*source.shape, len(LAGS)))
    for column, lag in enumerate(LAGS):
        apart = np.full(source.shape, 9.0)
        apart[:, lag:] = whole[:, lag:] - whole[:, :-lag]
        before = np.concatenate([share[:, :lag], share[:, :-lag]], axis=1)
        # Weights 1 − s and s of a frame and the next: their own, less what both have in common.
        alone = (1 - share) ** 2 + share**2 + (1 - before) ** 2 + before**2
        common = (apart == 0) * ((1 - share) * (1 - before) + share * before)
        common += (apart == 1) * (1 - share) * before
        out[..., column] = alone - 2.0 * common
    return out
