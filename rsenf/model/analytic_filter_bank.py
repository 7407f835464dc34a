"""The paper's filter bank: the effect on any signal's spectrum of leaving out the idle rows.

A camera without an idle period would read ``M`` rows in a frame period (the *capacity*); it reads
``L`` of them. Dropping the others and closing the gaps is an ``L``-branch polyphase structure. Its
output spectrum is a sum of shifted copies of the input's, each weighted by a gain ``F_m``.

Equations of the paper (Vatansever, Dirik and Memon, IEEE TIFS 2019) are numbered here and in the
other files of the line model by their order in the manuscript: ``F_m`` is Eq. 7 (label ``Fm``).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]


def branch_gain(omega: ArrayLike, m: ArrayLike, rows: int, capacity: float) -> ComplexArray:
    """Gain ``F_m(ω)`` of the ``m``-th shifted copy, the sum of Eq. 7 (``Fm``) in closed form.

    Parameters
    ----------
    omega : array_like of float
        Angular frequency of the output, radians per row.
    m : array_like of int
        Index of the copy; broadcast with ``omega``.
    rows : int
        ``L``, rows of a frame.
    capacity : float
        ``M``, rows that would fit in a frame period; needn't be an integer.

    Returns
    -------
    ndarray of complex128

    Examples
    --------
    >>> abs(branch_gain(0.0, 0, 540, 720.0)).item()
    0.75
    """
    step = np.asarray(
        (np.asarray(omega) * (capacity - rows) + 2 * math.pi * np.asarray(m)) / capacity
    )
    whole = np.abs(np.sin(step / 2)) < 1e-12  # all terms of the sum are equal
    half = np.where(whole, 1.0, step / 2)
    total = np.where(whole, rows, np.sin(rows * half) / np.sin(half))
    turn = np.where(whole, 1.0, np.exp(-1j * half * (rows - 1)))
    return np.asarray(total * turn / capacity, np.complex128)


def output_spectrum(
    spectrum: Callable[[FloatArray], ComplexArray], omega: ArrayLike, rows: int, capacity: int
) -> ComplexArray:
    """Spectrum ``Y(ω)`` of the concatenated rows, Eq. 6 (``Eq_Filterbank``).

    Parameters
    ----------
    spectrum : callable
        ``X(ω)``, the discrete-time Fourier transform of the light sampled without idle periods, at
        an array of angular frequencies.
    omega : array_like of float (frequencies,)
        Angular frequencies of the output, radians per row.
    rows, capacity : int
        ``L`` and ``M``; the polyphase derivation requires integers.

    Returns
    -------
    ndarray of complex128 (frequencies,)
    """
    w = np.asarray(omega, np.float64)[:, None]
    m = np.arange(capacity)
    copies = spectrum((w * rows - 2 * math.pi * m) / capacity)
    return np.asarray((copies * branch_gain(w, m, rows, capacity)).sum(axis=1))
