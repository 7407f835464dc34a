"""Options come from the settings: their names, help, choices and values; completion of them all."""

from __future__ import annotations

import argparse
import ast
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rsenf.bench.live import LivePlan
from rsenf.bench.recording_time import RecordingPlan
from rsenf.bench.scenes import Plan
from rsenf.cli import VERBS, main, verb_parser
from rsenf.cli.console import OF_IMPORT
from rsenf.cli.options import NAMES, SPELT, Option, field_docs, options_of, settings_of
from rsenf.config.schemas import RecordSettings
from rsenf.errors import UsageError
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.idle import IdleSettings
from rsenf.live import LiveSettings
from rsenf.match import METHODS as MATCHERS
from rsenf.match import MatchSettings
from rsenf.model import CATALOGUE
from rsenf.model.light import LAMPS
from rsenf.reference.readings import ReadOptions
from rsenf.rows.settings import RowsSettings
from rsenf.track import METHODS as ENF_METHODS
from rsenf.track import TrackSettings
from tests.house import modules

Said = pytest.CaptureFixture[str]
# What a verb must be told, and the settings that its options make.
ANALYSING: list[tuple[list[str], list[type[Any]]]] = [
    (["track", "a.mp4"], [RowsSettings, TrackSettings]),
    (["idle", "a.mp4"], [RowsSettings, IdleSettings]),
    (
        ["verify", "a.mp4", "--reference", "r.csv"],
        [RowsSettings, TrackSettings, MatchSettings, ReadOptions],
    ),
    (
        ["live", "a.mp4", "--reference", "r.csv"],
        [RowsSettings, TrackSettings, LiveSettings, ReadOptions],
    ),
    (["discover", "a.mp4", "--out", "o"], [RowsSettings, ReadOptions]),
    (["reference", "import", "r.csv"], [ReadOptions]),
    (["record", "--connect", "tcp/a:1", "--archive", "o"], [RecordSettings]),
    (["bench", "idle"], [Plan]),
    (["bench", "live"], [LivePlan]),
    (["bench", "recording-time"], [RecordingPlan]),
]
# Told by another argument of their verbs.
OTHERWISE = {"start_utc_ns", "assumed_hz", "part", "out", "archive"}
CASES = [
    pytest.param(words, settings, option, id=f"{' '.join(words[:2])} {option.name}")
    for words, every in ANALYSING
    for settings in every
    for option in options_of(settings)
    if option.name not in OTHERWISE
    and not (words[0] == "discover" and option.name in ("strips", "tile_means"))  # its own
    and not (settings is ReadOptions and words[0] != "reference" and option.name in OF_IMPORT)
]
# Values other than the default where a number near to it won't do.
VALUES: dict[str, Any] = {
    "method": "paper",
    "nominal_hz": 60.0,
    "column": "f",
    "time_column": "Zeit",
    "time_format": "%d/%m/%Y %H:%M:%S",
    "timezone": "Europe/Paris",
    "strips": 4,
    "line_m": -1,
    "sizes": ("240p",),
    "size": "240p",
    "frame_rates": ("25",),
    "nominals_hz": (60.0,),
    "codings": ("80k",),
    "topics": ("cam1/track",),
    "step_s": 2.0,
    "retention.days": 3.0,
    "retention.disk_share": 0.5,
    "alarms.trigger": "cam1/alarm",
}


def other_value(option: Option) -> Any:
    """Return a value that isn't the default."""
    if option.name == "method" and option.choices:
        return option.choices[-1]
    if option.name in VALUES:
        return VALUES[option.name]
    if option.choices:
        return next(choice for choice in option.choices if choice != option.default)
    if option.kind is bool:
        return not option.default
    if option.kind is int:
        return 16 if option.default == 8 else option.default - 1
    limits = {f"limits.{name}": value for name, value in vars(LiveSettings().limits).items()}
    return 0.9 * limits.get(option.name, option.default) or 0.1


@pytest.mark.parametrize(("words", "settings", "option"), CASES)
def test_every_field_is_an_option_that_arrives(
    words: list[str], settings: type[Any], option: Option
) -> None:
    value = other_value(option)
    spelt = f"--{option.spelt[0]}"
    if isinstance(value, bool):
        given = [spelt if value else f"--no-{option.spelt[0]}"]
    else:
        given = [f"{spelt}={','.join(map(str, value)) if isinstance(value, tuple) else value}"]
    args = verb_parser(words[0]).parse_args([*words[1:], *given])
    found = settings_of(args, settings)
    for step in option.name.split("."):
        found = getattr(found, step)
    assert found == value
    assert found != option.default


@pytest.mark.parametrize(
    "settings", dict.fromkeys(s for _, every in ANALYSING for s in every), ids=lambda s: s.__name__
)
def test_every_field_has_help(settings: type[Any]) -> None:
    assert [o.name for o in options_of(settings) if not o.help and o.name != "part"] == []


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["track"], ENF_METHODS),
        (["track"], ["neighbour_mean", "linear", "none"]),
        (["verify"], MATCHERS),
        (["verify"], ENF_METHODS),
        (["idle"], IDLE_METHODS),
        (["batch", "idle"], IDLE_METHODS),
        (["batch", "track"], ENF_METHODS),
        (["batch", "verify"], MATCHERS),
        (["live"], ENF_METHODS),
        (["simulate"], LAMPS),
        (["simulate"], CATALOGUE),
        (["bench", "discover"], ["harmonics", "frame_drop"]),
        (["tables"], ["cosine", "rectified"]),
    ],
)
def test_help_lists_what_there_is(words: list[str], names: Any, capsys: Said) -> None:
    assert main(["help", *words]) == 0
    said = capsys.readouterr().out.replace(",", " ").split()
    assert set(names) <= {word.strip("{}()") for word in said}


@pytest.mark.parametrize(
    ("words", "dest", "value"),
    [
        (["track", "a", "--method", "stft"], "enf_method", "stft"),
        (["track", "a", "--enf-method", "stft"], "enf_method", "stft"),
        (["track", "a", "--line", "-2"], "line_m", -2),
        (["track", "a", "--read-out", "columns"], "read_out_axis", "columns"),
        (["track", "a", "--no-mask"], "mask", False),
        (["idle", "a", "--method", "coherent"], "idle_method", "coherent"),
        (["verify", "a", "--reference", "r", "--method", "ncc"], "method", "ncc"),
        (["verify", "a", "--reference", "r", "--tolerance-s", "2"], "tolerance_s", 2.0),
        (["record", "--connect", "a", "--archive", "b", "--rotate-mb", "5"], "rotate_mb", 5.0),
        (["bench", "recording-time", "--sizes", "240p"], "size", "240p"),
        (["simulate", "--out", "x.npz", "--codec", "vp9"], "codec", "vp9"),
    ],
)
def test_earlier_spellings_hold(words: list[str], dest: str, value: object) -> None:
    assert getattr(verb_parser(words[0]).parse_args(words[1:]), dest) == value


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("verify clip.mp4 --referense x", "no option --referense: did you mean '--reference'?"),
        ("track clip.mp4 --nominal=50 --windows 3", "no option --windows: did you mean '--window"),
        ("batch verify v --out o --metod ncc", "no option --metod: did you mean '--method'?"),
        ("bench live --clipz 3", "no option --clipz: did you mean '--clips'?"),
        ("track clip.mp4 --method projektion", "no 'projektion': did you mean 'projection'?"),
        ("simulate --out x.npz --lamp halogene", "no 'halogene': did you mean 'halogen'?"),
        ("simulate --out x.npz --codec h266", "no 'h266': did you mean 'h26"),
        ("batch trak v", "no 'trak': did you mean 'track'?"),
        ("track clip.mp4 --xyzzy", "no option --xyzzy (see"),
    ],
)
def test_the_nearest_is_named(words: str, told: str, capsys: Said) -> None:
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert told in err
    assert err.count("\n") == 1


def test_what_comes_after_two_dashes_is_nobodys_option() -> None:
    args = verb_parser("contract").parse_args(["--", "python", "node.py", "--verbose"])
    assert args.command == ["python", "node.py", "--verbose"]


def test_what_pydantic_refuses_is_one_line() -> None:
    args = argparse.Namespace(flush_every_s=99.0)
    with pytest.raises(UsageError, match=r"^flush-every-s: .*60$"):
        settings_of(args, RecordSettings)
    with pytest.raises(UsageError, match=r"^retention: days -1.0: a finite number above 0$"):
        settings_of(argparse.Namespace(keep_days=-1), RecordSettings)


def test_docstrings_are_read() -> None:
    class Told:
        """Something.

        Parameters
        ----------
        one_s, two_s : float
            Of ``both``, in :data:`rsenf.where`. More of it.
        three : {'a', 'b'}
            NMEA stays.

        Raises
        ------
        UsageError
            Never.
        """

    of_both = "of both, in where"
    assert field_docs(Told) == {
        "one_s": of_both,
        "two_s": of_both,
        "three": "NMEA stays",
    }


@pytest.fixture(scope="module")
def bash(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[str]]:
    """Complete a line in bash, as pressing the tabulator does."""
    file = tmp_path_factory.mktemp("completion") / "rsenf.bash"
    with pytest.MonkeyPatch.context() as patch, file.open("w") as out:
        patch.setattr("sys.stdout", out)
        assert main(["completion", "bash"]) == 0
    subprocess.run(["bash", "-n", file], check=True)

    def complete(line: str) -> list[str]:
        words = line.split(" ")
        script = f"""
            source {file}
            COMP_WORDS=({" ".join(words[:-1])} '{words[-1]}'); COMP_CWORD={len(words) - 1}
            $(complete -p rsenf | sed 's/.*-F \\([^ ]*\\) .*/\\1/') rsenf
            printf '%s\\n' "${{COMPREPLY[@]}}"
        """
        done = subprocess.run(
            ["bash", "-c", script], capture_output=True, text=True, check=True, timeout=60
        )
        return done.stdout.split()

    return complete


def test_bash_completes_verbs_options_and_names(bash: Callable[[str], list[str]]) -> None:
    assert set(VERBS) <= set(bash("rsenf "))
    assert bash("rsenf ver") == ["verify"]
    assert "--nominal-hz" in bash("rsenf track --nom")
    assert set(ENF_METHODS) <= set(bash("rsenf track --enf-method "))
    assert "--clips" in bash("rsenf bench live --cl")


def test_bash_completes_files(
    bash: Callable[[str], list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "clip.mp4").touch()
    monkeypatch.chdir(tmp_path)
    assert bash("rsenf track cl") == ["clip.mp4"]
    assert bash("rsenf simulate --model cl") == ["clip.mp4"]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells(shell: str, capsys: Said) -> None:
    assert main(["completion", shell]) == 0
    assert "read-out-axis" in capsys.readouterr().out


@pytest.mark.parametrize("key", [key for key in (*SPELT, *NAMES) if "." in key])
def test_options_are_of_settings_that_there_are(key: str) -> None:
    owner, field = key.split(".")
    classes = [
        node
        for path in modules().values()
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and node.name == owner
    ]
    fields = {
        part.target.id
        for node in classes
        for part in node.body
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)
    }
    assert field in fields
