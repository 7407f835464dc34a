"""What every ENF method must do, whoever made it; and that a faulty one is caught.

A value is held against the grid's mean over the second about its ``t_s``, whatever window it is
from: a method that averages over 20 s says how far that may be from its middle second, and that
is part of its standard error.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.messages import EnfEstimate, RowBlock, canonical
from rsenf.rows.settings import RowsSettings
from rsenf.run.runner import Runner
from rsenf.track import METHODS, EnfMethod, TrackSettings, make_tracker
from rsenf.track.method import CHOICES
from rsenf.track.projection import ProjectionTracker
from tests.contracts.clips import CELLS, FOREIGN, NOTHING_THERE, Cell, clip, flicker_free

# Root mean square of the error over the stated one. Errors of overlapping windows hang together,
# so that of one short clip may be nearly twice what it is on average.
MOST_Z = 2.0
MOST_RMS_HZ = 5e-3  # who states more than that is of no use, however honest
# Where every method has what it needs, and may not refuse.
CLEAR = (CELLS[0], CELLS[1], FOREIGN)
SPLIT_HZ = 1e-9  # sums over blocks of another length are rounded otherwise


def run(method: str, blocks: Sequence[RowBlock], **settings: Any) -> list[EnfEstimate]:
    stage = make_tracker(TrackSettings(method=method, **settings))
    return [e for block in blocks for e in stage.update(block)] + stage.flush()


def check_declaration(method: str) -> None:
    kind = METHODS[method]
    assert kind.name == method
    assert kind.help
    assert "\n" not in kind.help
    assert kind.obeys <= set(CHOICES)
    RowsSettings(**kind.rows_needed)
    for name, value in (("harmonic", 2), ("line_m", 0), ("interpolation", "linear")):
        settings = TrackSettings(method=method, **{name: value})
        if name in kind.obeys:
            kind.check(settings)
        else:
            with pytest.raises(UsageError, match=f"{method} takes no {name.removesuffix('_m')}"):
                kind.check(settings)


def check_accuracy(
    method: str, cell: Cell, most_z: float = MOST_Z, most_rms_hz: float = MOST_RMS_HZ
) -> None:
    filmed = clip(cell)
    own = [e for e in run(method, filmed.blocks) if e.rank == 0]
    usable = [e for e in own if e.usable]
    assert all(e.method == method for e in own)
    assert len(own) >= 10
    assert all(e.usable or (e.reason and np.isnan(e.enf_hz)) for e in own)
    assert cell not in CLEAR or len(usable) >= 0.75 * len(own)
    if not usable:
        return
    t_s = np.array([e.t_s for e in usable])
    error_hz = np.array([e.enf_hz for e in usable]) - filmed.mean_hz(t_s - 0.5, t_s + 0.5)
    z = error_hz / np.sqrt([e.enf_var_hz2 for e in usable])
    assert np.sqrt(np.mean(z**2)) <= most_z
    assert np.sqrt(np.mean(error_hz**2)) <= most_rms_hz


def check_refusal(method: str, what: str) -> None:
    needed = METHODS[method].rows_needed
    blocks = flicker_free(**needed) if what == "flicker_free" else NOTHING_THERE[what]()
    own = [e for e in run(method, blocks) if e.rank == 0]
    assert own, "it has to say that there is nothing"
    assert not any(e.usable for e in own)
    assert all(e.reason for e in own)


def check_streaming(method: str) -> None:
    """What comes is what came before it made it, whatever else is going on in the process."""
    blocks, others = clip(CELLS[0]).blocks, clip(FOREIGN).blocks
    alone = [canonical(e) for e in run(method, blocks)]
    # Beside another of its kind, message by message.
    one, other = (make_tracker(TrackSettings(method=method)) for _ in range(2))
    out = []
    for block, foreign in zip(blocks, others, strict=False):
        other.update(foreign)
        out += one.update(block)
    rest = [e for block in blocks[len(others) :] for e in one.update(block)]
    assert [canonical(e) for e in [*out, *rest, *one.flush()]] == alone
    # In a second epoch.
    runner = Runner("track", lambda: make_tracker(TrackSettings(method=method)))
    for block in others[:40]:
        runner.feed(block)
    anew = [dataclasses.replace(b, header=dataclasses.replace(b.header, epoch=1)) for b in blocks]
    sent = [e for block in anew for e in runner.feed(block) if e.header.epoch == 1]
    first = run(method, blocks)
    assert len(sent) > 5
    assert [e.enf_hz for e in sent] == pytest.approx(
        [e.enf_hz for e in first[: len(sent)]], abs=0.0, nan_ok=True
    )
    # In blocks of another length.
    for frames in (1, 13):
        split = run(method, clip(CELLS[0], frames).blocks)
        assert [e.usable for e in split] == [e.usable for e in first]
        assert [e.enf_hz for e in split] == pytest.approx(
            [e.enf_hz for e in first], abs=SPLIT_HZ, nan_ok=True
        )


@pytest.mark.parametrize("method", METHODS)
def test_it_declares_what_it_is(method: str) -> None:
    check_declaration(method)


@pytest.mark.parametrize("cell", CELLS, ids=str)
@pytest.mark.parametrize("method", METHODS)
def test_it_is_within_its_own_errors(method: str, cell: Cell) -> None:
    check_accuracy(method, cell)


@pytest.mark.parametrize("what", NOTHING_THERE)
@pytest.mark.parametrize("method", METHODS)
def test_it_finds_nothing_where_nothing_is(method: str, what: str) -> None:
    check_refusal(method, what)


@pytest.mark.parametrize("method", METHODS)
def test_it_says_in_a_stream_what_it_says_of_a_file(method: str) -> None:
    check_streaming(method)


class Off(ProjectionTracker):
    """Wrong by 0.15 Hz."""

    name = "faulty"

    def update(self, message: RowBlock) -> list[Any]:
        return self._spoilt(super().update(message))

    def flush(self) -> list[Any]:
        return self._spoilt(super().flush())

    def _spoilt(self, out: list[Any]) -> list[Any]:
        return [dataclasses.replace(e, enf_hz=e.enf_hz + 0.15) for e in out]


class TooSure(Off):
    """Its errors are ten times what it says."""

    def _spoilt(self, out: list[Any]) -> list[Any]:
        return [dataclasses.replace(e, enf_var_hz2=e.enf_var_hz2 / 100.0) for e in out]


class Never(Off):
    """Refuses whatever it sees."""

    def _spoilt(self, out: list[Any]) -> list[Any]:
        return [
            dataclasses.replace(e, usable=False, enf_hz=np.nan, reason="who knows?") for e in out
        ]


class Always(Off):
    """Has a value for everything."""

    def _spoilt(self, out: list[Any]) -> list[Any]:
        return [dataclasses.replace(e, usable=True, enf_hz=50.0) for e in out]


class Shared(Off):
    """Keeps what it has seen where all of its kind find it."""

    seen: list[float] = []  # noqa: RUF012  # the fault

    def _spoilt(self, out: list[Any]) -> list[Any]:
        self.seen.extend(e.enf_hz for e in out)
        mean_hz = float(np.nanmean(self.seen)) if self.seen else 0.0
        return [dataclasses.replace(e, enf_hz=0.5 * (e.enf_hz + mean_hz)) for e in out]


@pytest.mark.parametrize(
    ("fault", "check", "of"),
    [
        (Off, check_accuracy, (CELLS[0],)),
        (Off, check_accuracy, (FOREIGN,)),
        (TooSure, check_accuracy, (CELLS[0],)),
        (Never, check_accuracy, (CELLS[0],)),
        (Always, check_refusal, ("noise",)),
        (Always, check_refusal, ("constant",)),
        (Always, check_refusal, ("flicker_free",)),
        (Shared, check_streaming, ()),
    ],
    ids=lambda x: getattr(x, "__name__", None),
)
def test_a_fault_is_caught(
    fault: type[EnfMethod], check: Any, of: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(METHODS, "_items", dict(METHODS._items))
    monkeypatch.setattr(fault, "name", "faulty")
    METHODS.register("faulty", fault)
    with pytest.raises(AssertionError):
        check("faulty", *of)


@pytest.mark.parametrize(
    ("method", "why"),
    [
        (type("Lacking", (EnfMethod,), {"name": "mine", "help": "x", "update": id}), "lacks flush"),
        (type("Plain", (), {}), "mine is no rsenf.track.EnfMethod"),
        (type("Other", (METHODS["stft"],), {"name": "other"}), "other is added as mine"),
    ],
)
def test_what_is_no_method_is_told_before_it_is_used(method: Any, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        METHODS.register("mine", method)
    assert "mine" not in METHODS
