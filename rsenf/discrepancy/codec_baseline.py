"""Baseline of a codec: what it makes of a recording that lacks nothing; no effect is named for it.

What a fit says, put through the recording's own codec, is data without a discrepancy: its gap is
part of the floor, and what effects seem to explain of it is what they must beat on the data.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rsenf.discrepancy.candidates import seeming_gains
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.measured import Float32Array

# Encoders are alike in what they do, not the same: by how much the data must exceed it (gaps of
# clips without an effect were 0.1 to 2.5 of those foretold, x264 at several presets and rates), and
# how much of the gap another encoder may have shaped like any effect.
BEYOND, ANY = 3.0, 0.5


@dataclass(frozen=True)
class CodecBaseline:
    """A gap, and gains of effects by name, such as a codec alone may bring about.

    Attributes
    ----------
    gap : float
        Over the power of the flicker, as one such codec left it.
    gains : mapping of str to float
        Of each effect, by its name, over the same power.
    """

    gap: float
    gains: Mapping[str, float]

    @property
    def most(self) -> float:
        """Gap that another codec of the kind may leave."""
        return BEYOND * self.gap

    def of(self, name: str) -> float:
        """What an effect may gain by such a codec alone."""
        return BEYOND * self.gains.get(name, 0.0) + ANY * self.gap


NOTHING = CodecBaseline(0.0, {})


def usual_of(fitted: Fit, recoded: Callable[[Float32Array], Float32Array] | None) -> CodecBaseline:
    """See what a codec does to data that a fit itself has made.

    Parameters
    ----------
    fitted : Fit
        Of the recording.
    recoded : callable or None
        Returns what the codec leaves of rows, (frames, lines, strips); None where there is none.
    """
    if recoded is None:
        return NOTHING
    level = fitted.data.as_lines(recoded(fitted.data.as_recorded(fitted.rows)))
    data = dataclasses.replace(fitted.data, level=level)
    again = fit(fitted.theory, data)
    return CodecBaseline(abs(again.gap.value), seeming_gains(again))
