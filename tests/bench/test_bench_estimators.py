"""Estimators on a foreign camera: what it films, how it counts, that a run is resumed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rsenf.bench import CAMERA
from rsenf.bench.foreign import NEEDED, RAW, EstimatorPlan, ForeignCase, camera_at
from rsenf.bench.foreign.table import _tabulated, _tasks_of, _text, _tried
from rsenf.cli import main
from rsenf.errors import UsageError
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.track import METHODS as ENF_METHODS

PATH = Path(__file__).resolve().parents[2] / CAMERA


def test_kinds_rates_and_grids_take_turns() -> None:
    camera = camera_at(PATH, NEEDED)
    cases = EstimatorPlan(raw=300, coded=30, nothing=300, filtered=60, first_seed=70).cases(camera)
    filtered = [c for c in cases if camera.KINDS[c.kind].filtered]
    assert {c.kind for c in filtered} == set(camera.FILTERS)
    assert {c.coding for c in filtered} == {"lossless", "camera"}
    assert len(filtered) == 60
    whole = [c for c in cases if c not in filtered]
    lit, dark = ([c for c in whole if c.mains is mains] for mains in (True, False))
    raw, coded = ([c for c in lit if (c.coding == RAW) is is_raw] for is_raw in (True, False))
    assert [len(some) for some in (raw, coded, dark)] == [300, 30, 300]
    assert {c.kind for c in cases} == set(camera.KINDS)
    assert {c.coding for c in coded} == set(list(camera.CODINGS)[1:])
    assert all(camera.KINDS[c.kind].filmable for c in coded)
    assert all(camera.KINDS[c.kind].mains == c.mains for c in cases)
    places = {(c.kind, c.frame_rate, c.nominal_hz, c.grid) for c in raw}
    assert len(places) == len(raw)
    # A larger plan has what a smaller one has.
    fewer = EstimatorPlan(raw=40, coded=0, nothing=0, first_seed=70).cases(camera)
    assert set(fewer) < set(raw)
    (only,) = EstimatorPlan(raw=1, coded=0, nothing=0, kinds=("gamma",)).cases(camera)
    assert only.kind == "gamma"
    with pytest.raises(UsageError, match="no kind 'candle'"):
        EstimatorPlan(kinds=("candle",)).cases(camera)


def test_every_method_is_tried_or_those_that_are_named() -> None:
    case = ForeignCase("led", True, "25", 60.0, "continental", RAW, 1, 24.0)
    every = _tasks_of([case], ())
    assert [method for _, _, method in every.values()] == [*ENF_METHODS, *IDLE_METHODS]
    assert "enf stft: led 25fps 60Hz continental raw 1 24s" in every
    assert [of for _, of, _ in _tasks_of([case], ("stft", "coherent")).values()] == ["enf", "idle"]
    with pytest.raises(UsageError, match="no method 'guess'"):
        _tasks_of([case], ("guess",))


def test_a_lamp_is_found_and_held_against_the_truth() -> None:
    case = ForeignCase("led", True, "24000/1001", 50.0, "continental", RAW, 3, 24.0)
    enf = _tried(case, "enf", "projection", PATH)["found"]
    assert len(enf["error_mhz"]) > 20
    assert max(map(abs, enf["error_mhz"])) < 1.0
    idle = _tried(case, "idle", "coherent", PATH)["found"]
    assert idle["verdict"] == "estimated"
    assert abs(idle["error_percent"]) < 0.05
    assert idle["inside"]
    assert not idle["turned"]


@pytest.mark.external
def test_a_coded_film_is_decoded() -> None:
    case = ForeignCase("led", True, "30000/1001", 50.0, "continental", "camera", 3, 12.0)
    idle = _tried(case, "idle", "coherent", PATH)["found"]
    assert abs(idle["error_percent"]) < 2.0


def _record(seed: int, of: str, found: dict[str, Any], **more: Any) -> dict[str, Any]:
    case = {
        "kind": "led", "mains": True, "frame_rate": "25", "nominal_hz": 60.0, "seed": seed,
        "grid": "rough", "coding": RAW, "duration_s": 4.0,
    } | more  # fmt: skip
    return {**case, "of": of, "method": "one", "found": found, "versions": {"source": "a"}}


def _enf(errors: list[float], std: float = 1.0) -> dict[str, Any]:
    t_s = [0.5 + n for n in range(len(errors))]
    return {"t_s": t_s, "error_mhz": errors, "std_mhz": [std] * len(errors), "cpu_s": 1.0}


def _idle(error: float, std: float, *, inside: bool = True) -> dict[str, Any]:
    return {
        "verdict": "estimated", "error_percent": error, "std_percent": std, "inside": inside,
        "turned": False, "cpu_s": 1.0,
    }  # fmt: skip


def test_errors_are_counted_by_cell() -> None:
    document = _tabulated(
        [
            _record(1, "enf", _enf([3.0, -4.0])),
            _record(2, "enf", _enf([0.0, 12.0, 0.0, 0.0], std=1.0)),
            _record(3, "enf", {"broke": "ValueError: no"}),
        ]
    )
    (row,) = document["rows"]
    assert row["rms"] == row["z"] == pytest.approx((169 / 6) ** 0.5)
    assert row["usable_ratio"] == pytest.approx(6 / 12)
    assert (row["far"], row["broke"], row["cases"], row["median"]) == (1, 1, 3, 1.5)
    assert row["inside_ratio"] == pytest.approx(0.5)
    assert document["beyond"] == document["rows"]


def test_idle_periods_are_counted() -> None:
    said = [_idle(0.1, 0.1), _idle(-0.3, 0.1, inside=False), {"verdict": "refused", "cpu_s": 1.0}]
    (row,) = _tabulated([_record(n, "idle", found) for n, found in enumerate(said)])["rows"]
    assert row["z"] == pytest.approx(5**0.5)
    assert row["usable_ratio"] == pytest.approx(2 / 3)
    assert row["inside_ratio"] == 0.5


def test_what_is_said_of_nothing_is_false() -> None:
    dark: dict[str, Any] = {"kind": "stripes", "mains": False}
    document = _tabulated(
        [
            _record(1, "enf", _enf([9e3, 9e3]), **dark),
            _record(2, "enf", _enf([]), **dark),
            _record(1, "idle", _idle(0.1, 0.1), **dark),
            _record(2, "idle", {"verdict": "no_signal", "cpu_s": 1.0}, **dark),
        ]
    )
    enf, idle = document["rows"]
    assert (enf["false_claims"], enf["false_seconds"], enf["z"], enf["far"]) == (1, 2, None, 0)
    assert (idle["false_claims"], idle["usable_ratio"]) == (1, None)
    assert len(document["beyond"]) == 2
    for on_page in (False, True):
        written = _text(document, on_page=on_page)
        assert "1 false of 2" in written
        assert "no lamp" in written


def test_a_quick_run_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["bench", "foreign", "--quick", "--methods", "stft,coherent", "--json", "--jobs", "1"]
    words += ["--camera", str(PATH), "--out", str(tmp_path), "--seed", "4"]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["records"] == 6
    assert {row["method"] for row in document["rows"]} == {"stft", "coherent"}
    kept = (tmp_path / "estimators.jsonl").read_bytes()
    assert main(words) == 0
    assert (tmp_path / "estimators.jsonl").read_bytes() == kept
