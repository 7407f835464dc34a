"""From nothing to a site's graph: cameras looked at, a graph written, a camera tracked."""

from __future__ import annotations

import json
import os
import pty
import re
import secrets
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote

import av
import numpy as np
import pytest
import yaml

from rsenf.api.probe import _flicker, probe
from rsenf.cli import verb_parser
from rsenf.config.site_graph import (
    check_names,
    keeping,
    site_nodes,
    target_of,
    without_passwords,
)
from rsenf.decode import SourceSpec, open_source
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, EXIT_USAGE, UsageError
from rsenf.flicker import mains
from rsenf.flicker.acquire import NO_FLICKER
from rsenf.messages import EnfEstimate
from rsenf.run import live_input
from rsenf.run.inline import Analysis
from tests.decode import rtsp_server

Rsenf = Callable[..., subprocess.CompletedProcess[str]]
CAMERAS = [
    "--camera",
    "door=rtsp://me:secret@127.0.0.1:9/1",
    "--camera",
    "yard=rtsp://127.0.0.1:9/2",
]


@pytest.fixture
def needs_server() -> None:
    if lacking := rtsp_server.missing():
        pytest.skip(lacking)


def test_options_make_a_graph_that_can_be_run(rsenf: Rsenf, tmp_path: Path) -> None:
    (tmp_path / "grid.csv").write_text("time,frequency\n2026-01-01T00:00:00Z,50\n")
    hook = "https://me:secret@example.org/hook?token=secret"
    told = ["--notify", hook, "--notify", "https://example.org/T1/secret-path",
            "--notify", "mqtt://127.0.0.1:1884",
            "--notify", "mailto:a@example.org,b@example.org?from=c@example.org&host=mail",
            "--notify", "/bin/echo https://example.org/2?token=secret"]  # fmt: skip
    made = rsenf("init", *CAMERAS, *told, "--grid", 50, "--no-probe", "--yes", "--reference",
                 "grid.csv", "--folder", "kept", cwd=tmp_path)  # fmt: skip
    assert made.returncode == EXIT_DONE, made.stderr
    text = (tmp_path / "graph.yaml").read_text()
    nodes = yaml.safe_load(text)["nodes"]
    assert nodes["live"]["cameras"] == ["door", "yard"]
    assert nodes["mains"]["input"] == "grid.csv"
    assert nodes["record"]["archive"] == "kept"
    assert [target["via"] for target in nodes["notify"]["to"]] == [
        "webhook",
        "webhook",
        "mqtt",
        "email",
        "exec",
    ]
    assert "secret" not in text + made.stdout + made.stderr
    secrets = tmp_path / "graph.env"
    assert stat.S_IMODE(secrets.stat().st_mode) == 0o600
    assert "rtsp://me:secret@127.0.0.1:9/1" in secrets.read_text()
    assert hook in secrets.read_text()
    assert "https://example.org/2?token=secret" in secrets.read_text()
    assert "rsenf run graph.yaml --env graph.env --metrics" in made.stdout
    checked = rsenf("validate", "graph.yaml", "--env", "graph.env", cwd=tmp_path)
    assert checked.returncode == EXIT_DONE, checked.stderr


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ([], EXIT_USAGE, "no camera"),
        (["--camera", "a=rtsp://x/1", "--camera", "a=rtsp://x/2"], EXIT_USAGE, "one name"),
        (["--camera", "track=rtsp://x/1"], EXIT_USAGE, "can't be called 'track'"),
        (["--camera", "a b=rtsp://x/1"], EXIT_USAGE, "can't be called 'a b'"),
        ([*CAMERAS, "--notify", "ftp://x"], EXIT_USAGE, "ftp://x: nobody"),
        ([*CAMERAS, "--reference", "grid.csv"], EXIT_USAGE, "no reference grid.csv: no such file"),
        ([*CAMERAS, "--notify", "mailto:a@b"], EXIT_USAGE, "nobody can be told"),
        (CAMERAS, EXIT_FAILED, "rtsp://***@127.0.0.1:9/1: connection refused"),
        (CAMERAS, EXIT_FAILED, "rtsp://127.0.0.1:9/2: connection refused"),
        (CAMERAS, EXIT_FAILED, "2 of 2 cameras can't be used now"),
    ],
)
def test_what_can_not_be_leaves_nothing(
    rsenf: Rsenf, tmp_path: Path, words: list[str], code: int, said: str
) -> None:
    made = rsenf("init", *words, cwd=tmp_path, stdin=subprocess.DEVNULL)
    assert made.returncode == code
    assert said in made.stderr
    assert "secret" not in made.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_graph_is_not_replaced_unasked(rsenf: Rsenf, tmp_path: Path) -> None:
    (tmp_path / "graph.yaml").write_text("mine")
    words = ["init", *CAMERAS, "--no-probe", "--yes"]
    assert rsenf(*words, cwd=tmp_path).returncode == EXIT_USAGE
    assert (tmp_path / "graph.yaml").read_text() == "mine"
    assert rsenf(*words, "--force", cwd=tmp_path).returncode == EXIT_DONE
    (tmp_path / "graph.yaml").unlink()
    probes = rsenf("init", *CAMERAS, cwd=tmp_path, stdin=subprocess.DEVNULL)
    assert "graph.env is there already" in probes.stderr  # before a camera is looked at
    assert probes.returncode == EXIT_USAGE


def test_no_camera_has_the_name_of_another_node() -> None:
    cameras = {"door": "rtsp://127.0.0.1:9/1", "yard": "rtsp://127.0.0.1:9/2"}
    nodes = keeping("archive", [target_of("/bin/echo")], page=True)
    for reference in (None, "grid.csv", "rtsp://127.0.0.1:9/3"):
        nodes |= site_nodes(cameras, reference)
    check_names(list(cameras))
    for name in nodes:
        with pytest.raises(UsageError):
            check_names([*cameras, name])


@pytest.mark.parametrize(
    ("cameras", "cores", "parts"),
    [(1, 8, [1]), (2, 8, [2]), (3, 8, [1, 1, 1]), (7, 2, [4, 3]), (7, 1, [7])],
)
def test_many_cameras_are_tracked_on_all_cores(cameras: int, cores: int, parts: list[int]) -> None:
    named = {f"cam{k}": f"rtsp://127.0.0.1:9/{k}" for k in range(cameras)}
    nodes = site_nodes(named, "grid.csv", {"track": {"track": {"nominal_hz": 50.0}}}, cores)
    track = {name: node for name, node in nodes.items() if node["kind"] == "track"}
    assert [len(node["cameras"]) for node in track.values()] == parts
    assert sorted(camera for node in track.values() for camera in node["cameras"]) == list(named)
    assert all(node["track"] == {"nominal_hz": 50.0} for node in track.values())
    for name in track:
        with pytest.raises(UsageError):
            check_names([*named, name])


def test_each_address_has_a_variable_of_its_own() -> None:
    cameras = {name: f"rtsp://me:secret@127.0.0.1/{name}" for name in ("a-b", "a_b", "A.b", "1")}
    nodes, variables = without_passwords(site_nodes(cameras, None))
    for name, url in cameras.items():
        (variable,) = re.findall(r"^\$\{([A-Za-z_]\w*)\}$", nodes[name]["input"])
        assert variables[variable] == url


def test_on_a_terminal_it_asks(tmp_path: Path) -> None:
    ours, its = pty.openpty()
    answers = "rtsp://127.0.0.1:9/1\ndoor\nrtsp://127.0.0.1:9/2\ndoor\nlive\n\n\n50\n"
    answers += "no.csv\n\n\n"
    answers += "mailto:a@b\n/bin/echo\n\n"
    command = [sys.executable, "-m", "rsenf.cli", "init", "--no-probe"]
    with subprocess.Popen(
        command, stdin=its, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    ) as process:
        os.write(ours, answers.encode())
        _, said = process.communicate(timeout=60)
    os.close(ours)
    os.close(its)
    assert process.returncode == EXIT_DONE, said
    assert "two cameras have one name" in said
    assert "can't be called 'live'" in said
    assert "no reference no.csv: no such file" in said
    assert "mailto:a@b: nobody can be told by this" in said
    nodes = yaml.safe_load((tmp_path / "graph.yaml").read_text())["nodes"]
    assert [node["camera"] for node in nodes.values() if node["kind"] == "decode"] == [
        "door",
        "cam2",
    ]
    assert nodes["track"]["track"] == {"nominal_hz": 50.0}
    assert nodes["notify"]["to"] == [{"via": "exec", "command": ["/bin/echo"]}]
    # Without a reference the cameras judge each other.
    assert [node["grid"] for node in nodes.values() if node["kind"] == "live"] == ["cam2", "door"]


def probed(rsenf: Rsenf, url: object, *words: object) -> dict[str, Any]:
    found = rsenf("probe", url, "--json", *words)
    assert found.returncode == EXIT_DONE, found.stderr
    shown: dict[str, Any] = json.loads(found.stdout)
    return shown


def test_a_film_with_flicker_is_seen_to_have_it(rsenf: Rsenf, clip: Path) -> None:
    found = probed(rsenf, clip, "--seconds", 20)
    assert (found["codec"], found["width_px"], found["height_px"]) == ("h264", 320, 240)
    assert found["flicker"] == "seen"
    assert found["nominal_hz"] == 50
    assert found["stamps"] == "steady"
    assert found["frame_rate_hz"] == pytest.approx(found["declared_rate_hz"], rel=1e-3)
    assert found["advice"] == []


def test_an_exposure_of_whole_periods_swallows_it(rsenf: Rsenf, tmp_path: Path) -> None:
    film = tmp_path / "film.mp4"
    words = ["--out", film, "--effect", "exposure:exposure_s=0.01", "--duration-s", 15, "--size",
             "160x120", "--seed", 3]  # fmt: skip
    assert rsenf("simulate", *words).returncode == EXIT_DONE
    found = probed(rsenf, film, "--seconds", 12, "--grid", 50)
    assert found["flicker"] == "not_seen"
    assert any(line.startswith("the exposure: ") for line in found["advice"])


@pytest.mark.parametrize(
    ("reasons", "flicker"),
    [
        ([mains.FAINT] * 9 + [NO_FLICKER] * 3, "swallowed"),
        ([mains.FAINT] + [NO_FLICKER] * 11, "not_seen"),
        ([mains.FAINT] + [mains.PATTERN] * 11, "cannot_tell"),
        ([NO_FLICKER] * 5 + [mains.TOO_STEADY] * 7, "cannot_tell"),
        ([mains.TOO_BRIEF] * 12, "cannot_tell"),
        ([mains.UNFILTERED] * 12, "cannot_tell"),
    ],
)
def test_the_exposure_is_to_blame_only_where_most_seconds_show_nothing(
    reasons: list[str], flicker: str
) -> None:
    estimates = [EnfEstimate(reason=why) for why in reasons]
    found = Analysis(estimates=estimates, stretches_s=[float(len(reasons))])
    assert _flicker(found, 50.0)[0] == flicker


def test_a_camera_is_probed_in_full(clip: Path) -> None:
    asked: list[str] = []

    def opened(spec: SourceSpec, **more: Any) -> Any:
        asked.append(spec.effort)
        return open_source(spec, **more)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(live_input, "open_source", opened)
        probe(str(clip), seconds=1.0)
    assert asked == ["full"]


def in_presentation_order(clip: Path, out: Path) -> Path:
    """Encode a clip anew without B frames, as a camera does."""
    with av.open(str(clip)) as film, av.open(str(out), "w") as made:
        into = made.add_stream("libx264", film.streams.video[0].average_rate)
        into.width, into.height = film.streams.video[0].width, film.streams.video[0].height
        into.options = {"bf": "0", "crf": "16", "g": "15"}
        into.thread_type = "NONE"  # no sliced pictures: see rtsp_server
        for frame in film.decode(video=0):
            made.mux(into.encode(av.VideoFrame.from_ndarray(frame.to_ndarray(), "yuv420p")))
        made.mux(into.encode())
    return out


@pytest.mark.external
@pytest.mark.usefixtures("needs_server")
def test_a_camera_is_probed_and_tracked_until_ctrl_c(
    rsenf: Rsenf, clip: Path, tmp_path: Path
) -> None:
    film = in_presentation_order(clip, tmp_path / "film.mp4")
    with rtsp_server.RtspServer(file=film) as server:
        found = probed(rsenf, server.url, "--seconds", 3)
        assert (found["codec"], found["width_px"]) == ("h264", 320)
        command = [sys.executable, "-m", "rsenf.cli", "track", server.url, "--json"]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            lines = [process.stdout.readline() for _ in range(3)]
            process.send_signal(signal.SIGINT)
            rest, said = process.communicate(timeout=60)
    # A busy machine drops pictures, and the film ends: both are told.
    told = "pictures dropped for lack of time" in said or "ended the stream" in said
    assert process.returncode == (EXIT_LOSS if told else EXIT_DONE), said
    values = [json.loads(line) for line in [*lines, *rest.splitlines()] if line]
    assert len(values) >= 3 or told, said
    assert [line["t_s"] for line in values[:3]] == [0.5, 1.5, 2.5][: len(values)], said
    assert all(abs(line["enf_hz"] - 50) < 0.2 for line in values if line["usable"])
    assert "secret" not in said


def growing_reference(path: Path, stop: threading.Event) -> None:
    """Write a grid's frequency of the last two minutes, and a line each second until stopped."""
    moment, values = datetime.now(UTC).replace(microsecond=0), np.random.default_rng(1)
    lines = ["time,frequency"]
    lines += [f"{(moment - timedelta(seconds=k)).isoformat()},50.01" for k in range(120, 0, -1)]
    path.write_text("\n".join([*lines, ""]))

    def grow(moment: datetime) -> None:
        while not stop.wait((moment - datetime.now(UTC)).total_seconds()):
            with path.open("a") as table:
                table.write(f"{moment.isoformat()},{50.01 + values.normal(0, 0.002):.5f}\n")
            moment += timedelta(seconds=1)

    threading.Thread(target=grow, args=(moment,), daemon=True).start()


@pytest.mark.external
@pytest.mark.usefixtures("needs_server")
def test_a_camera_is_judged_until_ctrl_c(tmp_path: Path) -> None:
    """Its test picture doesn't flicker, which takes a while to be certain."""
    stop, grid, lines = threading.Event(), tmp_path / "grid.csv", list[str]()
    growing_reference(grid, stop)
    with rtsp_server.RtspServer(user="me", password="secret") as server:
        command = [sys.executable, "-m", "rsenf.cli", "live", server.url, "--reference", str(grid)]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                lines.append(line)
                if "no_signal" in line:
                    break
            process.send_signal(signal.SIGINT)
            rest, said = process.communicate(timeout=60)
    stop.set()
    assert "undecided" in lines[0], said
    assert "no_signal" in lines[-1], said
    assert "at the end no_signal" in rest
    assert process.returncode in (EXIT_DONE, EXIT_LOSS), said
    assert "secret" not in "".join(lines) + rest + said


@pytest.mark.external
@pytest.mark.usefixtures("needs_server")
def test_cameras_that_send_are_looked_at_and_others_kept_on_request(
    rsenf: Rsenf, tmp_path: Path
) -> None:
    words = ["--camera", "gone=rtsp://127.0.0.1:9/1", "--seconds", 2, "--grid", 50]
    with rtsp_server.RtspServer(user="me", password="secret") as server:
        words += ["--camera", f"door={server.url}"]
        refused = rsenf("init", *words, cwd=tmp_path, stdin=subprocess.DEVNULL)
        assert refused.returncode == EXIT_FAILED
        assert list(tmp_path.iterdir()) == []
        made = rsenf("init", *words, "--yes", cwd=tmp_path)
    assert made.returncode == EXIT_DONE, made.stderr
    assert "gone: rtsp://127.0.0.1:9/1: connection refused" in made.stderr
    (door,) = (line for line in made.stderr.splitlines() if line.startswith("door: "))
    assert ": h264, 320x240, " in door
    nodes = yaml.safe_load((tmp_path / "graph.yaml").read_text())["nodes"]
    cameras = [node["camera"] for node in nodes.values() if node["kind"] == "decode"]
    assert cameras == ["gone", "door"]
    assert "secret" not in made.stdout + made.stderr + (tmp_path / "graph.yaml").read_text()


TRANSMITTER = "http://www.onvif.org/ver10/network/wsdl", "NetworkVideoTransmitter"


@pytest.fixture
def announced() -> Iterator[str]:
    """A camera that answers on the network, under a name that no other has."""
    wsdiscovery = pytest.importorskip("wsdiscovery")
    from wsdiscovery.publishing import ThreadedWSPublishing

    name, answering = f"Door {secrets.token_hex(3)}", ThreadedWSPublishing()
    answering.start()
    answering.publishService(
        types=[wsdiscovery.QName(*TRANSMITTER)],
        scopes=[wsdiscovery.Scope(f"onvif://www.onvif.org/name/{quote(name)}")],
        xAddrs=["http://192.0.2.7/onvif/device_service"],
    )
    yield name.replace(" ", "-")
    answering.stop()


# Without IPv6 the answering thread for it ends with an error.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.external
def test_cameras_on_the_network_are_found(rsenf: Rsenf, announced: str, tmp_path: Path) -> None:
    words = ["init", "--discover", "--no-probe"]
    found = rsenf(*words, cwd=tmp_path, stdin=subprocess.DEVNULL)
    assert f"found {announced} at 192.0.2.7" in found.stderr
    assert "their streams aren't known" in found.stderr
    assert found.returncode == EXIT_USAGE
    assert list(tmp_path.iterdir()) == []


UNITS = sorted((Path(__file__).parents[2] / "configs" / "deploy").glob("*.service"))


@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.name)
def test_a_service_says_what_there_is(unit: Path) -> None:
    (command,) = re.findall(r"^ExecStart=/usr/bin/env rsenf (.*)$", unit.read_text(), re.MULTILINE)
    verb, *words = shlex.split(command)
    assert verb_parser(verb).parse_args(words).graph.name == "graph.yaml"
    if not shutil.which("systemd-analyze"):
        pytest.skip("needs systemd-analyze")
    checked = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False
    )
    assert (checked.returncode, checked.stderr) == (0, "")
