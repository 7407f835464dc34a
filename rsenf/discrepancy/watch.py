"""The watch: runs the workflow on the newest window of a stream, and reports what changed.

The first window gives a model of the camera; each later window begins with the model found so far.
Known effects thus stay explained, and an effect that a window adds, loses or changes, or a residual
that it leaves, is reported as a change of the camera.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np
import yaml

from rsenf.discrepancy.fit_parameters import filled, series_of
from rsenf.discrepancy.result import model_of
from rsenf.discrepancy.settings import SHORTEST_WINDOW_S, WatchSettings
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.window import (
    Look,
    WindowBuffer,
    WindowSummary,
    look,
    missing_in,
    names_of,
    part_of,
    rest_of,
    seen_in,
)
from rsenf.errors import InputError
from rsenf.messages import DiscoveryVerdict, FoundEffect, RowBlock
from rsenf.model import CaptureModel, Effect
from rsenf.model.effects import DeliveryEffect
from rsenf.model.effects.codec import GopAttenuation
from rsenf.model.parameters import fittings
from rsenf.timebase import NS_PER_S

# A parameter has changed if it did by more than both: standard errors, and relative.
MOVED_STDS, MOVED_RATIO = 6.0, 0.01
WORTH_NS = 3 * NS_PER_S  # least length of new rows for a verdict at the end of a stream
# Effects at certain frames, which are numbered from the window's first.
OF_ONE_WINDOW = (DeliveryEffect, GopAttenuation)
SHORTEST_NS = round(SHORTEST_WINDOW_S * NS_PER_S)


def changes(before: WindowSummary, now: WindowSummary) -> tuple[str, ...]:
    """Describe the differences between two windows, one line each."""
    return (*_new_and_gone(before, now), *_moved(before, now), *_unexplained(before, now))


def _new_and_gone(before: WindowSummary, now: WindowSummary) -> Iterator[str]:
    were = {name for effect in before.effects for name in names_of(effect)}
    are = {name for effect in now.effects for name in names_of(effect)}
    for effect in now.effects:
        if not were.intersection(names_of(effect)):
            yield f"{_called(effect)} is new{_measures(effect)}"
    for effect in before.effects:
        if not are.intersection(names_of(effect)):
            yield f"{_called(effect)} is gone"


def _moved(before: WindowSummary, now: WindowSummary) -> Iterator[str]:
    for (part, name), (value, error) in now.values.items():
        was, was_error = before.values.get((part, name), (value, error))
        sure = MOVED_STDS * math.hypot(error, was_error)
        if abs(value - was) > max(sure, MOVED_RATIO * abs(was)):
            yield f"{part}.{name} went from {was:.4g} to {value:.4g}"


def _unexplained(before: WindowSummary, now: WindowSummary) -> Iterator[str]:
    if now.verdict == "unexplained" != before.verdict:
        yield "something is new that no effect explains"
    if before.verdict == "unexplained" != now.verdict:
        yield "nothing is left unexplained"


def _called(effect: FoundEffect) -> str:
    return " or ".join(names_of(effect))


def _measures(effect: FoundEffect) -> str:
    """Describe the fitted parameters of an effect, and at how many frames it occurs."""
    fitted = zip(effect.parameter_names, effect.parameters, effect.parameter_std, strict=True)
    said = [f"{name} {value:.6g} ± {std:.2g}" for name, value, std in fitted if math.isfinite(std)]
    at = sum(name.startswith("at_frames") for name in effect.parameter_names)
    said += [f"{at} times in this window"] if at else []
    return f" ({', '.join(said)})" if said else ""


class WatchStage:
    """Runs the workflow on the newest rows of a stream. Implements ``rsenf.stage.Stage``.

    Parameters
    ----------
    settings : WatchSettings
    given : CaptureModel, optional
        Initial model.
    is_behind : callable, optional
        Asked when a verdict is due: whether to skip it for lack of time.
    run : callable, optional
        Runs a long computation and returns its result, or None if it was given up; then no verdict
        comes.
    """

    def __init__(
        self,
        settings: WatchSettings,
        given: CaptureModel = PLAIN,
        is_behind: Callable[[], bool] = lambda: False,
        run: Callable[[Callable[[], Look]], Look | None] = lambda work: work(),
    ) -> None:
        self._settings, self._given = settings, given
        self._is_behind, self._run = is_behind, run
        self._window_ns = round(settings.window_s * NS_PER_S)
        self._every_ns = round(settings.every_s * NS_PER_S)
        self._rows = WindowBuffer(settings.lines)
        self._model = given
        self._before: WindowSummary | None = None
        self._newest: RowBlock | None = None  # usable or not
        self._reason = "no frame can be read"  # why the last unusable block was so
        self._due_ns, self._judged_ns = 0, 0
        self._published, self._skipped = 0, 0

    def update(self, message: RowBlock) -> list[DiscoveryVerdict]:
        """Take a block of rows; return the verdicts that are due."""
        if message.frames == 0:
            return []
        if self._newest is None:
            self._judged_ns = int(message.frame_pts_ns[0])
            self._due_ns = self._judged_ns + self._window_ns
        out, first = [], 0
        while message.frame_pts_ns[-1] >= self._due_ns:
            end = int(np.searchsorted(message.frame_pts_ns, self._due_ns))
            self._take(message, first, end)
            out += self._when_due(int(message.frame_pts_ns[end]))
            first = end
        self._take(message, first, message.frames)
        return out

    def flush(self) -> list[DiscoveryVerdict]:
        """Return the verdict on the newest rows, if they are enough for one."""
        if self._newest is None:
            return []
        end_ns = int(self._newest.frame_pts_ns[-1]) + 1
        since_ns = end_ns - self._judged_ns
        if self._published and (since_ns < WORTH_NS or self._rows.span_ns < SHORTEST_NS):
            return []
        self._rows.forget_before(end_ns - self._window_ns)
        return self._judge(end_ns)

    def _take(self, block: RowBlock, first: int, end: int) -> None:
        """Add some frames of a block to the buffer."""
        if first == end:
            return
        self._newest = part_of(block, first, end)
        if block.usable:
            self._rows.add(self._newest)
        else:
            self._reason = block.reason

    def _when_due(self, next_ns: int) -> list[DiscoveryVerdict]:
        """Judge the window that ends now, unless behind; the next frame is at ``next_ns``."""
        due_ns = self._due_ns
        self._due_ns += self._every_ns * (1 + (next_ns - due_ns) // self._every_ns)
        self._rows.forget_before(due_ns - self._window_ns)
        if self._is_behind():
            self._skipped += 1
            return []
        return self._judge(due_ns)

    def _judge(self, end_ns: int) -> list[DiscoveryVerdict]:
        """Run the workflow on the buffered rows, up to a time of the stream."""
        self._judged_ns = end_ns
        blocks = self._rows.blocks()
        if not blocks:
            return [self._blank(self._reason)]
        models = [self._model, self._given] if self._model != self._given else [self._given]
        try:
            seeing = self._run(lambda: look(blocks, models, self._settings.nominal_hz))
        except InputError as exc:
            return [self._blank(exc.message)]
        return [self._verdict(seeing, end_ns)] if seeing else []

    def _verdict(self, seeing: Look, end_ns: int) -> DiscoveryVerdict:
        """Return the verdict as a message, and keep its summary for the next window."""
        found, before, blank = seeing.found, self._before, self._blank()
        now = seen_in(found, self._given, before.effects if before else ())
        model = model_of(found, f"{blank.header.source}, as seen by the watch")
        stay = {effect.name for effect in now.model.effects}
        model = dataclasses.replace(
            model, effects=tuple(e for e in model.effects if e.name in stay)
        )
        verdict = dataclasses.replace(
            blank,
            verdict=found.verdict,
            effects=now.effects,
            gap_before=seeing.gap_before,
            gap_after=found.gap_after,
            gap_floor=found.floor.median,
            gap_limit=found.floor.limit,
            gap_stderr=found.last.gap.stderr,
            changed=changes(before, now) if before else (),
            frames_missing=missing_in(found.last.data),
            model_yaml=str(yaml.safe_dump(model.to_dict(), sort_keys=False)),
        )
        if found.verdict == "unexplained":
            verdict = dataclasses.replace(verdict, **rest_of(found, seeing.gap_before))
            if before and before.verdict != "unexplained":
                # Begin anew: no model explains a window with a change of the camera in its midst.
                self._rows.forget_before(end_ns)
                self._due_ns = max(self._due_ns, end_ns + SHORTEST_NS)
        self._before, self._model = now, lasting(now.model)
        return verdict

    def _blank(self, reason: str = "") -> DiscoveryVerdict:
        """Return the next message without a result."""
        assert self._newest is not None
        header = self._rows.header or self._newest.header
        blank = DiscoveryVerdict(
            header=header.numbered(self._published),
            verdict="no_signal",
            reason=reason,
            windows_skipped=self._skipped,
        )
        self._published, self._skipped = self._published + 1, 0
        return blank


def lasting(model: CaptureModel) -> CaptureModel:
    """Return the part of a model that holds in other windows, too.

    Effects at certain frames, and series, belong to one window. So do phases: amplitudes with a
    phase begin at zero.
    """
    kept = [e for e in model.effects if not isinstance(e, OF_ONE_WINDOW) and not series_of(e)]
    return dataclasses.replace(model, effects=tuple(_without_phase(e) for e in kept))


def _without_phase(effect: Effect) -> Effect:
    turned = {name: f.turn for name, f in fittings(effect).items() if f.turn}
    return filled(effect, dict.fromkeys([*turned, *turned.values()], 0.0))
