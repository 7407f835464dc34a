"""How good the estimates are, second by second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.messages import EnfEstimate
from rsenf.report.panels import INK, MARK, SIGNAL, say_nothing

WIDE = 10.0  # errors whose sizes differ by more are drawn on a logarithmic scale


def draw_quality(
    error_axes: Any, snr_axes: Any, use_axes: Any, estimates: Sequence[EnfEstimate]
) -> None:
    """Draw standard errors, signal over noise, and which seconds are of use, one below the other.

    The three axes share their x axis.
    """
    error_axes.set_title("Quality of the signal over time")
    if not estimates:
        for axes in (error_axes, snr_axes, use_axes):
            say_nothing(axes, "no estimate: too short")
        return
    t_s = np.array([e.t_s for e in estimates])
    usable = np.array([e.usable for e in estimates])
    variances = np.array([e.enf_var_hz2 for e in estimates])
    std_mhz = 1e3 * np.sqrt(np.where(variances >= 0, variances, np.nan))
    snr_db = np.array([e.snr_db for e in estimates])
    _dots(error_axes, t_s, std_mhz, usable)
    if np.nanmax(std_mhz, initial=0.0) > WIDE * np.nanmin(std_mhz, initial=np.inf) > 0:
        error_axes.set_yscale("log")
        error_axes.yaxis.set_major_formatter("{x:g}")
    error_axes.set_ylabel("standard error\n(mHz)")
    _dots(snr_axes, t_s, snr_db, usable)
    snr_axes.set_ylabel("signal over\nnoise (dB)")
    half_s = float(np.median(np.diff(t_s))) / 2 if t_s.size > 1 else 0.5
    for flag, colour, label in ((True, SIGNAL, "of use"), (False, MARK, "of no use")):
        spans = [(t - half_s, 2 * half_s) for t in t_s[usable == flag]]
        # The two lie at different heights: colour isn't all that tells them apart.
        use_axes.broken_barh(spans, (0.55 if flag else 0.0, 0.45), color=colour, lw=0)
        use_axes.annotate(
            label, (1.0, 0.775 if flag else 0.225), (4, 0), xycoords="axes fraction",
            textcoords="offset points", va="center", color=colour, fontsize="small",
        )  # fmt: skip
    use_axes.set_ylim(0.0, 1.0)
    use_axes.set_yticks([])
    use_axes.set_ylabel("seconds", rotation=0, ha="right", va="center")
    use_axes.set_xlim(max(float(t_s[0]) - half_s, 0.0), float(t_s[-1]) + half_s)
    use_axes.set_xlabel("time in the recording (s)")


def _dots(axes: Any, t_s: Any, values: Any, usable: Any) -> None:
    """Draw a value for each second: dots, and crosses where it is of no use."""
    if not np.isfinite(values).any():
        axes.text(0.5, 0.5, "not known", ha="center", va="center", transform=axes.transAxes,
                  color=INK)  # fmt: skip
        axes.set_yticks([])
        return
    axes.plot(t_s[usable], values[usable], ".", color=SIGNAL, ms=4)
    axes.plot(t_s[~usable], values[~usable], "x", color=MARK, ms=4)
