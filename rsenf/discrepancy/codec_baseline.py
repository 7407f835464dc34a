"""Codec baseline: the gap, and the apparent gains of effects, that a codec alone produces.

The fitted model's rows contain no discrepancy. What they have after the recording's codec is due to
the codec: its gap is added to the noise floor, and the gain that an effect seems to have there is
subtracted from its gain on the data.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rsenf.discrepancy.candidates import seeming_gains
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.measured import Float32Array

# Encoders differ. BEYOND: factor by which the data must exceed the baseline (clips without an
# effect had 0.1 to 2.5 times the predicted gap, with x264 at several presets and rates). ANY: share
# of the baseline's gap that another encoder may put into the shape of any effect.
BEYOND, ANY = 3.0, 0.5


@dataclass(frozen=True)
class CodecBaseline:
    """Gap, and gains of effects, due to a codec alone.

    Attributes
    ----------
    gap : float
        Relative to the flicker's power.
    gains : mapping of str to float
        Of each effect by name, relative to the same power.
    """

    gap: float
    gains: Mapping[str, float]

    @property
    def most(self) -> float:
        """Largest gap that an encoder of this kind may leave."""
        return BEYOND * self.gap

    def of(self, name: str) -> float:
        """Largest gain of an effect that such an encoder alone may cause."""
        return BEYOND * self.gains.get(name, 0.0) + ANY * self.gap


NOTHING = CodecBaseline(0.0, {})


def usual_of(fitted: Fit, recoded: Callable[[Float32Array], Float32Array] | None) -> CodecBaseline:
    """Measure the codec baseline on the rows of a fitted model.

    Parameters
    ----------
    fitted : Fit
        Of the recording.
    recoded : callable or None
        Encodes and decodes rows (frames, rows, strips) as the recording was; None without a codec.
    """
    if recoded is None:
        return NOTHING
    level = fitted.data.as_lines(recoded(fitted.data.as_recorded(fitted.rows)))
    data = dataclasses.replace(fitted.data, level=level)
    again = fit(fitted.theory, data)
    return CodecBaseline(abs(again.gap.value), seeming_gains(again))
