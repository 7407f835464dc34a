"""Graphs that aren't the usual one: simulated cameras, several of them, a bus of others."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import Film
from live_run import LiveRun

from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.errors import EXIT_DONE
from rsenf.messages import canonical
from rsenf.record import open_recording
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import analyse
from rsenf.run.inputs import open_input_file
from rsenf.track import TrackSettings
from tests.conftest import ROOT

pytestmark = pytest.mark.processes


def tracked(path: Path, camera: str) -> list[bytes]:
    """Canonical estimates of a recording."""
    messages = open_recording(path).messages([f"rsenf/lab/{camera}/track"])
    return [canonical(m) for _, m, _ in messages if not m.header.is_end]


def expected(film: Film, camera: str) -> list[bytes]:
    recording = open_input_file(film.video, source=f"lab/{camera}")
    estimates = analyse(
        recording, rows=RowsSettings(), track=TrackSettings(nominal_hz=50.0)
    ).estimates
    return [canonical(e) for e in estimates]


def test_several_cameras_share_their_nodes(
    film: Film, live_run: type[LiveRun], tmp_path: Path
) -> None:
    """Frames over the bus, all at full speed, into one node: the hardest case for lossless."""
    path, out, cameras = tmp_path / "g.yaml", tmp_path / "o.mcap", ("a", "b", "c")
    path.write_text(
        "version: 1\nsite: lab\nnodes:\n"
        + "".join(
            f'  d{c}: {{kind: decode, camera: {c}, input: "{film.video}", frames: tcp,'
            " record_video: false, threads: 1}\n"
            for c in cameras
        )
        + "  rows: {kind: rows, cameras: [a, b, c]}\n"
        "  track: {kind: track, cameras: [a, b, c], track: {nominal_hz: 50}}\n"
        f'  record: {{kind: record, out: "{out}", topics: ["*/rows", "*/track"]}}\n'
    )
    run = live_run(path)
    assert run.wait() == EXIT_DONE, run.lines
    for camera in cameras:
        assert tracked(out, camera) == expected(film, camera)


def test_two_graphs_on_a_bus_of_others(film: Film, live_run: type[LiveRun], tmp_path: Path) -> None:
    """As between hosts: one decodes, the other tracks and records."""
    endpoint, out = free_endpoint(), tmp_path / "o.mcap"
    head = f"version: 1\nsite: lab\nbus: {{connect: ['{endpoint}']}}\nnodes:\n"
    near, far = tmp_path / "near.yaml", tmp_path / "far.yaml"
    near.write_text(
        head + f'  decode: {{kind: decode, camera: cam, input: "{film.video}", frames: fused,'
        " record_video: false}\n"
    )
    far.write_text(
        head + "  track: {kind: track, cameras: [cam], track: {nominal_hz: 50}}\n"
        f'  record: {{kind: record, out: "{out}"}}\n'
    )
    with open_bus(BusSettings(mode="router", listen=(endpoint,))):
        tracking = live_run(far).until("running", "track", "record")
        assert tracking.endpoint == endpoint
        decoding = live_run(near)
        assert decoding.wait() == EXIT_DONE
        assert tracking.wait() == EXIT_DONE
    assert tracked(out, "cam") == expected(film, "cam")


def test_a_bus_that_is_not_there_is_one_clear_line(live_run: type[LiveRun], tmp_path: Path) -> None:
    path, endpoint = tmp_path / "g.yaml", free_endpoint()
    path.write_text(
        f"version: 1\nsite: lab\nbus: {{connect: ['{endpoint}']}}\nnodes:\n"
        "  track: {kind: track, cameras: [cam]}\n"
    )
    run = live_run(path)
    assert run.wait() == 1
    assert len(run.lines) == 1
    assert run.error.startswith(f"rsenf: no bus at {endpoint}")


def test_the_simulator_as_a_camera(live_run: type[LiveRun], tmp_path: Path) -> None:
    path, out = tmp_path / "g.yaml", tmp_path / "o.mcap"
    path.write_text(
        "version: 1\nsite: lab\nnodes:\n"
        "  decode:\n    kind: decode\n    camera: cam\n"
        f"    input: {{model: {ROOT / 'configs/model/demo_480p.yaml'}, duration_s: 2}}\n"
        "  rows: {kind: rows, cameras: [cam]}\n"
        f'  record: {{kind: record, out: "{out}"}}\n'
    )
    run = live_run(path)
    assert run.wait() == EXIT_DONE, run.lines
    blocks = [m for t, m, _ in open_recording(out).messages() if t.endswith("/rows")]
    assert 55 <= sum(b.frames for b in blocks) <= 65
    assert blocks[0].rows == 480
