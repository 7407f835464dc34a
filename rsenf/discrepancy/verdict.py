"""The whole workflow on one recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.floor import Floor, floor_of
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.search import Step, needed, search
from rsenf.discrepancy.stamps import Stamps, gap_of_stamps, off_s, stamps_of
from rsenf.discrepancy.start import first_fit
from rsenf.discrepancy.usual import Usual, usual_of
from rsenf.discrepancy.where import Share, where
from rsenf.model import CaptureModel
from rsenf.model.effects.residue import NOTHING_FITS


@dataclass(frozen=True, eq=False)
class Discovery:
    """What was found.

    Attributes
    ----------
    first, last : Fit
        Before any effect was added, and after the last.
    steps : tuple of Step
        Those that added one.
    stamps : Stamps or None
        What the frames' stamps have shown, before any row was looked at.
    floor : Floor
        Of data that the last theory made.
    usual : Usual
        What the recording's codec may do by itself; nothing where there is none, or it is unknown.
    before, after : list of Share
        Where theory and data disagreed, and where they still do.
    refused : Step or None
        The last round, where it tried what it didn't add.
    """

    first: Fit
    last: Fit
    steps: tuple[Step, ...]
    stamps: Stamps | None
    floor: Floor
    usual: Usual
    before: list[Share]
    after: list[Share]
    refused: Step | None = None

    @property
    def gap_before(self) -> float:
        """Gap of the model to begin with: of rows and of stamps."""
        return self.first.gap.value + stamps_gap(self.first)

    @property
    def gap_after(self) -> float:
        """Gap of the model at last."""
        return self.last.gap.value + stamps_gap(self.last)

    @property
    def verdict(self) -> str:
        """``no_discrepancy``, ``explained`` or ``unexplained``."""
        if self.last.gap.most > self.floor.most or stamps_gap(self.last) > self.floor.limit:
            return "unexplained"
        return "explained" if self.steps or self.stamps else "no_discrepancy"

    @property
    def shrinkage(self) -> float:
        """Share of the gap above the floor that is gone; NaN where there was none."""
        above = self.gap_before - self.floor.median
        if abs(above) <= self.floor.limit - self.floor.median:
            return float("nan")
        return 1.0 - (self.gap_after - self.floor.median) / above


def stamps_gap(fit: Fit) -> float:
    """Share of the flicker's power that a fit's stamps get wrong."""
    return gap_of_stamps(off_s(fit.theory, fit.data), fit.data.nominal_hz)


def discover(
    model: CaptureModel,
    data: Measured,
    progress: Callable[[str], None] = lambda doing: None,
    recoded: Callable[[Float32Array], Float32Array] | None = None,
) -> Discovery:
    """Find what a model lacks of a recording, and add it.

    Parameters
    ----------
    model : CaptureModel
        To begin with.
    data : Measured
    progress : callable, optional
        Told what is being done.
    recoded : callable, optional
        Returns what the recording's codec leaves of rows, (frames, lines, strips).

    Raises
    ------
    InputError
        When the recording has no flicker to fit a model to.
    """
    progress("fitting the model")
    first = first_fit(model, data)
    disagreed = where(first)
    stamps = stamps_of(first)
    begun = last = stamps.fit if stamps else first
    if recoded:
        progress("coding the fitted model as the recording was")
    usual = usual_of(last, recoded)
    steps: list[Step] = []
    refused = None
    progress("looking for what is missing")
    for step, last in search(begun, usual):  # noqa: B007 (what it has led to is used below)
        if step.chosen is None:
            refused = step
            break
        steps.append(step)
        first = first.released(rows=True)
        progress(f"added {' or '.join(steps[-1].kin)}, looking for what else is missing")
    last, steps = needed(last, steps, usual)
    if steps:
        own = usual_of(last, recoded)
        if last.gap.most > NOTHING_FITS + own.most:  # then nothing that was added explains it
            last, steps = begun, []
        else:
            usual = own
    floor = refused.floor if refused and refused.before.theory is last.theory else floor_of(last)
    floor = floor.raised(usual.gap, usual.most)
    return Discovery(
        first, last, tuple(steps), stamps, floor, usual, disagreed, where(last), refused
    )
