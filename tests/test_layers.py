"""Imports point one way. This test is the map of the rooms, and keeps it true."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

BASE = {"errors", "registry", "timebase", "medians", "stage", "whole_file", "messages"}
SIGNAL = {"decode", "rows", "flicker", "track", "idle", "match", "model", "live"}
# Room -> rooms of rsenf it may import, besides itself.
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "registry": {"errors"},
    "timebase": set(),
    "version": set(),
    "help": set(),
    "stage": set(),
    "medians": set(),
    "whole_file": {"errors"},
    "messages": {"errors", "timebase"},
    **dict.fromkeys(SIGNAL, BASE),
    # What estimators of the ENF and of the idle period have in common.
    "track": {*BASE, "flicker"},
    "idle": {*BASE, "flicker"},
    "match": {*BASE, "flicker"},
    # A live feed is followed by what recordings are matched by.
    "live": {*BASE, "flicker", "match"},
    "reference": {*BASE, "flicker", "track"},
    "discrepancy": {*BASE, "rows", "flicker", "track", "idle", "match", "model"},
    "record": BASE,
    "bus": BASE,
    # A graph file is checked against the very settings of the stages.
    "config": {
        *BASE,
        "bus",
        "decode",
        "rows",
        "track",
        "idle",
        "match",
        "live",
        "model",
        "discrepancy",
        "record",
    },
    "report": {*BASE, "rows", "flicker", "track", "idle", "match", "live", "model", "discrepancy"},
    "run": {*BASE, *SIGNAL, "bus", "config", "discrepancy", "record", "reference"},
    # Looks at what the others publish and record; runs nothing.
    "dashboard": {*BASE, "bus", "config", "decode", "record"},
    # Every stage there is, with the settings of a recorded graph.
    "regress": {
        *BASE,
        *SIGNAL,
        "bus",
        "config",
        "record",
        "run",
        "discrepancy",
    },
    # What is done with recordings, for whoever calls it.
    "api": {
        *BASE,
        "version",
        *SIGNAL,
        "bus",
        "config",
        "record",
        "reference",
        "report",
        "run",
        "discrepancy",
    },
    # The same with many recordings.
    "batch": {*BASE, "api", "live", "match", "model", "record", "reference", "report", "run"},
    "bench": {
        *BASE,
        "api",
        "batch",
        *SIGNAL,
        "live",
        "discrepancy",
        "bus",
        "config",
        "record",
        "reference",
        "report",
        "run",
    },
    "cli": {
        *BASE,
        "help",
        "version",
        *SIGNAL,
        "api",
        "batch",
        "bus",
        "config",
        "dashboard",
        "record",
        "reference",
        "regress",
        "report",
        "run",
        "bench",
        "cli",
        "discrepancy",
    },
    "nodes": {
        *BASE,
        *SIGNAL,
        "bus",
        "config",
        "dashboard",
        "record",
        "reference",
        "run",
        "discrepancy",
    },
}
# What a signal room must not touch, whatever it is imported through.
NOT_FOR_SIGNALS = {"zenoh", "mcap", "yaml", "pydantic", "argparse", "rich", "subprocess"}


def _modules() -> list[Path]:
    return sorted([*ROOT.glob("rsenf/**/*.py"), *ROOT.glob("nodes/*.py")])


def _room(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return "nodes" if parts[0] == "nodes" else parts[1]


def _imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def _rooms_imported(path: Path) -> set[str]:
    names = [n.split(".") for n in _imports(path)]
    rooms = {parts[1] for parts in names if parts[0] == "rsenf" and len(parts) > 1}
    return {r for r in rooms if (ROOT / "rsenf" / r).is_dir() or (ROOT / f"rsenf/{r}.py").is_file()}


@pytest.mark.parametrize("path", _modules(), ids=lambda p: str(p.relative_to(ROOT)))
def test_room_imports_only_what_it_may(path: Path) -> None:
    room = _room(path)
    if room in ("__init__",):
        assert _rooms_imported(path) == {"api"}  # for type checkers, and when it is asked for
        return
    assert room in ALLOWED, f"a new room {room!r}: say here what it may import"
    assert _rooms_imported(path) <= ALLOWED[room] | {room}
    assert not any(n.split(".")[0] == "rsenf_nodes" for n in _imports(path))


@pytest.mark.parametrize("room", sorted(SIGNAL))
def test_signal_rooms_know_no_bus_config_or_wall_clock(room: str) -> None:
    for path in (ROOT / "rsenf" / room).glob("**/*.py"):
        names = _imports(path)
        assert not {n.split(".")[0] for n in names} & NOT_FOR_SIGNALS, path
        source = path.read_text(encoding="utf-8")
        assert "time.time(" not in source, f"{path}: the wall clock is handed in"
        assert "time.time_ns(" not in source, f"{path}: the wall clock is handed in"
        assert "scipy.signal" not in source, f"{path}: costs 0.7 s at import"


def test_layers_test_can_fail(tmp_path: Path) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("import zenoh\nfrom rsenf.bus import keys\n", encoding="utf-8")
    assert _rooms_imported(bad) == {"bus"}
    assert "zenoh" in _imports(bad)


def test_every_package_is_in_the_wheel() -> None:
    import tomllib

    listed = set(
        tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"][
            "packages"
        ]
    )
    there = {
        ".".join(p.parent.relative_to(ROOT).parts) for p in ROOT.glob("rsenf/**/__init__.py")
    } | {"rsenf_nodes"}
    assert listed == there


def test_each_dependency_has_its_licence_told() -> None:
    import re
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    of_extras = [need for name in extras if name != "dev" for need in extras[name]]
    needed = [*project["dependencies"], *of_extras]
    names = {re.split(r"[\[<>=]", need)[0] for need in needed}
    page = (ROOT / "rsenf/help/licences.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| ")]
    told = {name for row in rows for name in re.findall(r"[\w.-]+", row)}
    assert len(names) > 20
    assert names <= told
