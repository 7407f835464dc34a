"""Things by name: our own, other packages', misspelt ones and those that can't be loaded."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsenf.errors import UsageError
from rsenf.registry import Registry

BUILT_IN = {"square_root": "math:sqrt", "absolute": abs}


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Registry[object]:
    """Return a registry, with a package of somebody else's installed."""
    (tmp_path / "stranger.py").write_text("def cube(x):\n    return x**3\n")
    facts = tmp_path / "stranger-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(
        "[rsenf.tests]\ncube = stranger:cube\nabsolute = stranger:cube\nbroken = stranger:no\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return Registry("function", "rsenf.tests", BUILT_IN)


def test_own_come_first_and_are_imported_when_asked_for(installed: Registry[object]) -> None:
    assert list(installed) == ["square_root", "absolute", "cube", "broken"]
    assert installed["square_root"](9.0) == 3.0  # type: ignore[operator]
    assert installed["cube"](2) == 8  # type: ignore[operator]


def test_another_package_replaces_none_of_ours(installed: Registry[object]) -> None:
    assert installed["absolute"] is abs


def test_a_misspelt_name_gets_the_nearest(installed: Registry[object]) -> None:
    with pytest.raises(UsageError, match=r"no function 'cub'.*did you mean 'cube'.*square_root"):
        installed.find("cub")
    assert "cub" not in installed


def test_what_cannot_be_loaded_names_its_package(installed: Registry[object]) -> None:
    with pytest.raises(UsageError, match="'broken' of the package stranger can't be loaded"):
        installed.find("broken")


def test_what_is_no_such_thing_is_refused(installed: Registry[object]) -> None:
    def check(name: str, item: object) -> None:
        if name != "absolute" and not isinstance(item, type):
            raise UsageError(f"{name} is no class")

    classes = Registry[object]("class", "rsenf.tests", {"absolute": abs}, check)
    assert classes["absolute"] is abs, "what is rsenf's own is tested"
    with pytest.raises(UsageError, match=r"'cube' of the package stranger .* cube is no class"):
        classes.find("cube")
    with pytest.raises(UsageError, match="sum is no class"):
        classes.register("sum", sum)
    assert "sum" not in classes
