"""Samples of the store, read in slices."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import FloatArray, UInt32Array
from rsenf.reference.store.folder import Series
from rsenf.reference.store.sample_file import BLOCK, UNITS_PER_HZ

CACHED_BLOCKS = 8  # 25 MB
T = TypeVar("T", np.float64, np.uint32)


class Blocks:
    """Dense blocks of a series, the last few kept."""

    def __init__(self, series: Series) -> None:
        self.series = series
        self._kept: OrderedDict[int, tuple[FloatArray, UInt32Array]] = OrderedDict()

    def __getitem__(self, number: int) -> tuple[FloatArray, UInt32Array] | None:
        """Frequency (Hz, NaN in gaps) and readings of a block; None where nothing was measured."""
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        if number not in self.series.groups:
            return None
        freq_hz, readings = self.series.block(number).dense(number * BLOCK, BLOCK)
        # Whole units, so that a frequency is the double nearest to its six decimals.
        np.rint(freq_hz, out=freq_hz)
        freq_hz += self.series.nominal_hz * UNITS_PER_HZ
        freq_hz /= UNITS_PER_HZ
        self._kept[number] = freq_hz, readings
        if len(self._kept) > CACHED_BLOCKS:
            self._kept.popitem(last=False)
        return freq_hz, readings


class StoredSamples(Generic[T]):
    """One value for every sample, read as it is asked for: by slices, or as a whole array.

    Like a read-only ndarray of shape (n,), but a slice of it is an array of its own.
    """

    ndim = 1

    def __init__(self, blocks: Blocks, first: int, size: int, *, which: int, gap: T) -> None:
        self._blocks, self._first, self._which = blocks, first, which
        self._gap: T = gap
        self.size = size
        self.shape = (size,)
        self.dtype: np.dtype[T] = gap.dtype

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, key: slice) -> NDArray[T]:
        if not isinstance(key, slice):
            raise TypeError("samples of the store are read by slices; np.asarray() reads them all")
        asked = range(self.size)[key]
        if not asked:
            return np.empty(0, self.dtype)
        a, b = min(asked[0], asked[-1]), max(asked[0], asked[-1]) + 1
        return self._read(a, b)[:: asked.step]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Read everything."""
        return self[:].astype(dtype or self.dtype, copy=False)

    def __iter__(self) -> Iterator[T]:
        for start in range(0, self.size, BLOCK):
            yield from self[start : start + BLOCK]

    def _read(self, start: int, stop: int) -> NDArray[T]:
        a, b = self._first + start, self._first + stop
        out = np.empty(b - a, self.dtype)
        for number in range(a // BLOCK, -(-b // BLOCK)):
            low, high = max(a, number * BLOCK), min(b, (number + 1) * BLOCK)
            own, block = out[low - a : high - a], self._blocks[number]
            if block is None:
                own[:] = self._gap
            else:
                own[:] = block[self._which][low - number * BLOCK : high - number * BLOCK]
        return out
