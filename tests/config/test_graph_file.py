"""Graph files: every problem at once, each with its line and a way out."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from rsenf_nodes.decode import DecodeNode
from rsenf_nodes.match import MatchNode
from rsenf_nodes.reference import ReferenceNode

from rsenf.cli.console import OF_IMPORT
from rsenf.config import Graph, load_graph
from rsenf.config.graph import reader_of_frames, runs_ahead, sender_of
from rsenf.config.schemas import SimulatedInput
from rsenf.errors import EXIT_USAGE, ConfigError, UsageError
from rsenf.reference.readings import ReadOptions
from tests.conftest import ROOT

GOOD = """\
version: 1
site: lab
nodes:
  decode: {kind: decode, camera: cam1, input: clip.mp4}
  rows:   {kind: rows, cameras: [cam1]}
  track:  {kind: track, cameras: [cam1]}
  grid:   {kind: reference, grid: ce, input: ce.csv}
  match:  {kind: match, cameras: [cam1], grid: ce}
  record: {kind: record, out: all.mcap}
  idle:   {kind: idle, cameras: [cam1]}
"""


DECODE = """\
  decode:
    kind: decode
    camera: cam1
    input:
      model: ${CLIP}
      seed: ${SEED}
      duration_s: ${LONG:-9.5}
"""


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str], Graph]:
    def write_and_load(text: str) -> Graph:
        (tmp_path / "g.yaml").write_text(text, encoding="utf-8")
        return load_graph(tmp_path / "g.yaml")

    return write_and_load


@pytest.fixture
def problems(tmp_path: Path, load: Callable[[str], Graph]) -> Callable[[str], list[str]]:
    """Lines of the error that a text causes, each without the path: ``line: text``."""

    def find(text: str) -> list[str]:
        with pytest.raises(ConfigError) as caught:
            load(text)
        assert caught.value.exit_code == EXIT_USAGE
        start = f"{tmp_path / 'g.yaml'}:"
        assert all(line.startswith(start) for line in caught.value.problems)
        return [line.removeprefix(start) for line in caught.value.problems]

    return find


def test_a_good_graph_and_its_defaults(load: Callable[[str], Graph]) -> None:
    graph = load(GOOD)
    decode = graph.nodes["decode"]
    assert isinstance(decode, DecodeNode)
    assert (decode.frames, decode.record_video, decode.pace) == ("ring", True, False)
    assert decode.outputs() == [("frames", "cam1"), ("video", "cam1")]
    assert sender_of(graph, "track", "cam1") == "track"
    assert sender_of(graph, "idle", "cam1") == "idle"
    assert sender_of(graph, "reference", "ce") == "grid"
    assert sender_of(graph, "track", "cam2") == ""


@pytest.mark.parametrize(
    ("played", "ahead"),
    [
        ("input: clip.mp4", True),
        ("input: {model: a.json, duration_s: 9}", True),
        ("input: clip.mp4, pace: true", False),
        ("input: rtsp://host/cam", False),
        ("input: 'v4l2:0'", False),
    ],
)
def test_only_a_file_that_is_not_paced_runs_ahead(
    load: Callable[[str], Graph], played: str, ahead: bool
) -> None:
    decode = f"decode: {{kind: decode, camera: cam1, {played}}}"
    graph = load(f"version: 1\nsite: lab\nnodes:\n  {decode}\n")
    assert (runs_ahead(graph, "cam1"), runs_ahead(graph, "cam2")) == (ahead, False)


def test_only_a_file_is_counted_at_a_rate(
    load: Callable[[str], Graph], problems: Callable[[str], list[str]]
) -> None:
    text = GOOD.replace("input: clip.mp4", "input: INPUT, frame_rate_hz: 23.5")
    decode = load(text.replace("INPUT", "clip.h264")).nodes["decode"]
    assert isinstance(decode, DecodeNode)
    assert decode.frame_rate_hz == 23.5
    assert "is for files" in problems(text.replace("INPUT", "rtsp://host/cam"))[0]
    assert "frame_rate_hz" in problems(GOOD.replace("clip.mp4", "a.h264, frame_rate_hz: 0"))[0]


def test_a_rows_node_may_find_the_axis_by_itself(
    load: Callable[[str], Graph], problems: Callable[[str], list[str]]
) -> None:
    text = GOOD.replace("kind: rows, ", "kind: rows, rows: {read_out_axis: AXIS}, ")
    load(text.replace("AXIS", "auto"))
    assert "is not one of rows, columns, auto" in problems(text.replace("AXIS", "diagonal"))[0]


def test_every_problem_at_once_with_its_line(problems: Callable[[str], list[str]]) -> None:
    text = """\
version: 2
site: de/mo
bus: {conect: [tcp/a:1]}
nodes:
  decode:
    kind: decode
    camera: cam1
    input:
      modle: wall.yaml
      duration_s: long
  rows: {kind: rowz, cameras: [cam1]}
  rows2: {kind: rows, camera: [cam1], rows: {strip: 2}}
  track: {kind: track, cameras: [cam1], track: {nominal_hz: 55}}
  track: {kind: track, cameras: cam1}
  blank: {cameras: [cam1]}
  match:
    kind: match
    cameras: [cam1]
    grid: ce
    match: {min_secnds: 3}
  record: {kind: record, out: "${NOT_SET_ANYWHERE}", flush_every_s: 0}
  reference: {kind: reference, grid: ce, input: ce.csv, timezone: [Europe/Paris]}
  other: {kind: reference, grid: us, input: us.csv, time_format: mm/dd/yyyy}
"""
    found = problems(text)
    expected = [
        ("14", "stands here twice"),
        ("21", "environment variable NOT_SET_ANYWHERE is not set"),
        ("1", "version: '2' is not one of 1"),
        ("2", "site: no name: letters, digits"),
        (
            "3",
            "bus: unknown key 'conect'; did you mean 'connect'?; allowed: connect, largest",
        ),
        ("8", "nodes.decode.input: key 'model' is missing"),
        ("10", "nodes.decode.input.duration_s: Input should be a valid number"),
        ("9", "nodes.decode.input: unknown key 'modle'; did you mean 'model'?"),
        ("11", "nodes.rows.kind: 'rowz' is not one of dashboard, decode"),
        ("12", "nodes.rows2: key 'cameras' is missing"),
        ("12", "nodes.rows2.rows: unknown key 'strip'; did you mean 'strips'?; allowed: block"),
        ("12", "nodes.rows2: unknown key 'camera'; did you mean 'cameras'?; allowed: cameras"),
        ("14", "nodes.track.cameras: Input should be a list (read: 'cam1')"),
        ("15", "nodes.blank: key 'kind' is missing; one of dashboard"),
        ("20", "nodes.match.match: unknown key 'min_secnds'; did you mean 'min_seconds'?"),
        ("21", "nodes.record.flush_every_s: Input should be greater than 0 (read: 0)"),
        ("22", "nodes.reference.timezone: Input should be a valid string"),
        ("23", "nodes.other.time_format: no format of times 'mm/dd/yyyy'"),
    ]
    for line, words in expected:
        assert [f for f in found if f.startswith(f"{line}: ") and words in f], (line, words)
    assert len(found) == len(expected)
    assert "did you mean 'rows'?" in next(f for f in found if "rowz" in f)


def test_a_reference_is_read_in_a_graph_as_anywhere() -> None:
    """Every option of reading is a key of the node, with the same default."""
    node = ReferenceNode(kind="reference", grid="ce", input="ce.csv")
    for option in dataclasses.fields(ReadOptions):
        if option.name not in OF_IMPORT or option.name == "nominal_hz":
            assert getattr(node, option.name) == option.default
    assert node.reading == ReadOptions()


@pytest.mark.parametrize(
    ("change", "line", "words"),
    [
        (("input: clip.mp4}", "input: clip.mp4, frames: fused}"), 5, "nobody sends the frames"),
        (("cameras: [cam1], grid: ce", "cameras: [cam1, cam2], grid: ce"), 8, "track of camera"),
        (("grid: ce}", "grid: uk}"), 8, "nobody sends the reference 'uk'"),
        (("kind: rows, cameras: [cam1]", "kind: rows, cameras: [cam1, cam1]"), 5, "twice"),
        (("  track: ", "  again: {kind: rows, cameras: [cam1]}\n  track: "), 6, "'rows' sends the"),
        (("grid: ce}", "grid: ce, method: guess}"), 8, "no method 'guess'; one of phase, ncc"),
        (("  track:  {", "  track:  {track: {method: guess}, "), 6, "no method 'guess'; one of"),
        (("all.mcap}", "all.mcap, topics: [/x]}"), 9, "'/x' is no key expression"),
        (("idle, cameras: [cam1]", "idle, cameras: [cam2]"), 10, "nobody sends the rows"),
        (("  track:  {", "  track:  {track: {harmonic: 2}, "), 6, "projection has no use for it"),
        (("kind: idle, ", "kind: idle, idle: {method: guess}, "), 10, "no method 'guess'; one of"),
        (("kind: idle, ", "kind: idle, idle: {every_s: 0}, "), 10, "an estimate every 0"),
        (("  track:  {", "  track:  {idle: {method: guess}, "), 6, "no method 'guess'; one of"),
        (("  track:  {", "  track:  {idle: {}, "), 10, "'track' sends the idle of 'cam1' already"),
        (("camera: cam1", "camera: reference"), 4, "'reference' is taken"),
        (("camera: cam1", 'camera: "*"'), 4, "no name"),
        (("  rows: ", '  "a b": '), 5, "no name"),
        (
            ("  record:", "  other: {kind: record, out: all.mcap}\n  record:"),
            10,
            "'other' writes all.mcap already",
        ),
        (
            ("cameras: [cam1], grid: ce", "cameras: [cam1], grid: ce, method: metric3"),
            8,
            "metric3 needs the ENF method 'paper', not 'projection'",
        ),
        (("  track:  {", "  track:  {track: {method: guess}, idle: {}, "), 6, "no method 'guess'"),
        (
            ("kind: rows, ", "kind: rows, rows: {block_frames: 0}, "),
            5,
            "block_frames of 0: at least 1",
        ),
        (("site: lab", "site: lab\nbus: {zenoh: {scoutin/delay: 0}}"), 3, "unknown key"),
        (("site: lab", "site: lab\nbus: {connect: [tcp/a:1], listen: [tcp/b:1]}"), 3, "listens"),
    ],
)
def test_what_the_schema_can_not_see(
    problems: Callable[[str], list[str]], change: tuple[str, str], line: int, words: str
) -> None:
    assert change[0] in GOOD
    found = problems(GOOD.replace(*change, 1))
    assert any(f.startswith(f"{line}: ") and words in f for f in found), found


def test_a_metric_with_the_hypotheses_it_needs(load: Callable[[str], Graph]) -> None:
    track = "track:  {kind: track, cameras: [cam1], track: {method: paper, interpolation: linear}}"
    text = GOOD.replace("track:  {kind: track, cameras: [cam1]}", track)
    graph = load(text.replace("grid: ce}\n  record", "grid: ce, method: metric4}\n  record"))
    assert isinstance(graph.nodes["match"], MatchNode)
    assert graph.nodes["match"].method == "metric4"


def test_on_a_bus_of_others_inputs_may_come_from_elsewhere(
    load: Callable[[str], Graph], problems: Callable[[str], list[str]]
) -> None:
    elsewhere = "version: 1\nsite: lab\nbus: {connect: [tcp/a:1]}\nnodes:\n"
    load(elsewhere + "  track: {kind: track, cameras: [cam1]}\n")
    decode = "  d: {kind: decode, camera: cam1, input: a.mp4"
    load(elsewhere + decode + ", frames: tcp}\n")
    assert "nodes.d.frames: no node here reads the ring" in problems(elsewhere + decode + "}\n")[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "1: not a mapping"),
        ("- a\n- b\n", "1: not a mapping"),
        ("just words\n", "1: not a mapping"),
        ("a: [1\nb: 2\n", "2: not YAML"),
        ("a:\n\tb: 1\n", "2: not YAML"),
        ("a: {b: ${C}}\n", "within { } put ${…} in quotes"),
        ("a: 1\n---\nb: 2\n", "2: not YAML"),
        ("a: \x00\n", "1: not YAML"),
        ("a: &a [*a]\n", "by aliases of aliases"),
        (
            "a0: &a0 [x]\n"
            + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9)),
            "1: not YAML: more than 100000 values",
        ),
        ("a: " + 1_000_001 * "x", "1: not YAML: 1000004 characters"),
        ("a: " + 3000 * "[" + 3000 * "]", "1: nested without end"),
        ("site: 2026-99-99\n", "1: '2026-99-99' can't be read as timestamp"),
        ("site: !!int abc\n", "1: 'abc' can't be read as int"),
        ("site: !python/name:os.system x\n", "1: 'x' can't be read as"),
    ],
)
def test_what_is_no_mapping_or_no_yaml(
    problems: Callable[[str], list[str]], text: str, words: str
) -> None:
    assert any(words in line for line in problems(text))


def test_a_file_that_is_not_there_or_no_text(tmp_path: Path) -> None:
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    for name, words in (("none.yaml", "no such file"), ("binary.yaml", "text"), ("", "text")):
        with pytest.raises(UsageError, match=words) as caught:
            load_graph(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_variables(load: Callable[[str], Graph], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLIP", "/data/a: b #1.mp4")
    monkeypatch.setenv("SEED", "7")
    monkeypatch.setenv("SITE", "42")
    graph = load(
        GOOD.replace("  decode: {kind: decode, camera: cam1, input: clip.mp4}", DECODE)
        .replace("site: lab", 'site: "${SITE}"')
        .replace("all.mcap", '"${OUT:-out}/${SITE}.mcap"')
    )
    # Filled in where it stands: no variable becomes structure or a comment; what is written
    # within quotes stays text, what isn't may be a number.
    source = graph.nodes["decode"]
    assert isinstance(source, DecodeNode)
    assert source.input == SimulatedInput(model="/data/a: b #1.mp4", seed=7, duration_s=9.5)
    assert graph.site == "42"
    assert getattr(graph.nodes["record"], "out", "") == "out/42.mcap"


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.stem)
def test_the_examples_are_valid(
    path: Path, rsenf: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rsenf.cli import main

    for name in ("VIDEO", "REFERENCE", "OUT", "CAMERA", "CAMERA1", "CAMERA2", "CAMERA3"):
        monkeypatch.setenv(name, "/tmp/x")
    monkeypatch.chdir(ROOT)
    assert main(["validate", str(path)]) == 0


def test_examples_are_found() -> None:
    names = {p.stem for p in (ROOT / "configs").glob("*.yaml")}
    assert names >= {"file", "rtsp", "several-cameras", "simulated"}


def test_the_published_schema_refuses_what_the_program_refuses(
    problems: Callable[[str], list[str]],
) -> None:
    """An editor that knows only the JSON Schema sees the same unknown keys."""
    schema = json.loads((ROOT / "configs/schema/graph.schema.json").read_text(encoding="utf-8"))
    open_ones = [
        name
        for name, part in {**schema["$defs"], "Graph": schema}.items()
        if part.get("additionalProperties") is not False
    ]
    assert open_ones == []


def test_rows_are_sampled_as_those_that_read_them_need_it(
    load: Callable[[str], Graph],
    problems: Callable[[str], list[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = GOOD.replace("kind: track, ", "kind: track, track: {method: superpixel}, ")
    assert load(text).nodes["rows"].rows.tile_means  # type: ignore[attr-defined]
    assert not load(GOOD).nodes["rows"].rows.tile_means  # type: ignore[attr-defined]
    given = text.replace("kind: rows, ", "kind: rows, rows: {tile_means: '${MEANS}'}, ")
    monkeypatch.setenv("MEANS", "true")
    load(given)
    monkeypatch.setenv("MEANS", "false")
    (said,) = problems(given)
    assert said.startswith("5: nodes.rows.rows.tile_means: node 'track' needs tile_means true")


def test_numbers_may_be_variables(
    load: Callable[[str], Graph], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBER", "2")
    track = "kind: track, track: {method: stft, harmonic: '${NUMBER}'}, "
    node = load(GOOD.replace("kind: track, ", track)).nodes["track"]
    assert node.track.harmonic == 2  # type: ignore[attr-defined]


def test_a_program_that_reads_frames_has_no_part_in_the_ring(load: Callable[[str], Graph]) -> None:
    own = "  own: {kind: external, command: [sleep], reads: [cam1/frames]}\n  rows:"
    graph = load(GOOD.replace("  rows:", own))
    assert reader_of_frames(graph, "cam1") == "rows"
    alone = "\n".join(line for line in GOOD.splitlines() if "[cam1]" not in line)
    assert reader_of_frames(load(alone + "\n" + own.removesuffix("  rows:")), "cam1") == ""
