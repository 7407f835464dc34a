"""The published JSON Schemas against what the verbs print."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator, ValidationError

from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]
SCHEMAS = Path(__file__).resolve().parents[2] / "configs" / "schema"


def schema_of(name: str) -> dict[str, Any]:
    schema: dict[str, Any] = json.loads((SCHEMAS / f"{name}.schema.json").read_text())
    Draft202012Validator.check_schema(schema)
    return schema


def check(name: str, told: dict[str, Any]) -> None:
    """Hold a result to its schema, and the schema to all of its keys."""
    schema = schema_of(name)
    Draft202012Validator(schema).validate(told)
    assert told.keys() == schema["properties"].keys() == set(schema["required"])


@pytest.fixture(scope="module")
def noise(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute without a signal: whatever may be null is."""
    path = tmp_path_factory.mktemp("noise") / "noise.npz"
    np.savez(path, luminance=np.random.default_rng(2).normal(100, 1, 900), frame_rate_hz=30.0)
    return path


@pytest.fixture(scope="module")
def verdict(rsenf: Rsenf, hidden: HiddenClip, tmp_path_factory: pytest.TempPathFactory) -> Any:
    case = tmp_path_factory.mktemp("case") / "case.yaml"
    case.write_text("case: 0117\nreceived: 2026-01-15\n")
    done = rsenf("verify", hidden.clip, "--reference", hidden.reference, "--start",
                 hidden.start_utc, "--case", case, "--json")  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_verify(rsenf: Rsenf, verdict: Any, hidden: HiddenClip, noise: Path) -> None:
    check("verify", verdict)
    assert verdict["candidates"]
    assert verdict["claim"] == "supported"
    # As it is written: 0117 would be 79 to YAML, and the day a date.
    assert verdict["case"] == {"case": "0117", "exhibit": "", "examiner": "", "laboratory": "",
                               "received": "2026-01-15"}  # fmt: skip
    dark = rsenf("verify", noise, "--reference", hidden.reference, "--json")
    check("verify", json.loads(dark.stdout))


def test_verify_against(rsenf: Rsenf, hidden: HiddenClip) -> None:
    done = rsenf("verify", hidden.clip, "--against", hidden.clip, "--json")
    assert done.returncode == 0, done.stderr
    check("verify-against", json.loads(done.stdout))


def test_idle(rsenf: Rsenf, clip: Path, noise: Path) -> None:
    check("idle", json.loads(rsenf("idle", clip, "--json").stdout))
    check("idle", json.loads(rsenf("idle", noise, "--json").stdout))
    check("idle-compared", json.loads(rsenf("idle", clip, clip, "--json").stdout))


def test_track(rsenf: Rsenf, clip: Path, noise: Path) -> None:
    for path in (clip, noise):
        lines = rsenf("track", path, "--json").stdout.splitlines()
        assert lines
        for line in lines:
            check("track", json.loads(line))


@pytest.mark.parametrize(
    ("key", "value"),
    [("decision", "perhaps"), ("lag_s", "12.5"), ("candidates", [{"lag_s": 1.0}]), ("case", 4711)],
)
def test_what_is_otherwise_is_refused(verdict: Any, key: str, value: object) -> None:
    with pytest.raises(ValidationError):
        check("verify", verdict | {key: value})


def test_the_schema_of_a_case_file_has_its_keys(verdict: Any) -> None:
    schema = schema_of("case")
    Draft202012Validator(schema).validate(verdict["case"])
    assert verdict["case"].keys() == schema["properties"].keys()
    with pytest.raises(ValidationError):
        Draft202012Validator(schema).validate({"exhibits": "E-3"})


def test_verify_together(rsenf: Rsenf, hidden: HiddenClip) -> None:
    others = ["--against", hidden.clip, "--against", hidden.clip]
    done = rsenf("verify", hidden.clip, *others, "--json")
    assert done.returncode == 0, done.stderr
    check("verify-together", together := json.loads(done.stdout))
    assert together["decision"] == "match"
    assert [abs(one["begin_s"]) < 0.1 for one in together["recordings"]] == [True] * 3
    said = rsenf("verify", hidden.clip, *others)
    assert said.stdout.startswith("match: every one fits the first")
