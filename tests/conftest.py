"""What all tests share: where the measured data is, and clips made once for the whole session."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from types import FrameType
from typing import Any

import hypothesis
import pytest

# As in every process of rsenf, and before NumPy is imported: threads that fight for few cores cost
# many times their gain.
os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
# Else every process that a test starts compiles all of rsenf anew: half of what it costs.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# A shell has what it starts in the background ignore Ctrl-C, and so would all that a test starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

from rsenf.run.process import Patience
from tests.hidden_clip import HiddenClip, hide_clip

hypothesis.settings.register_profile("rsenf", deadline=None)  # a busy machine takes its time
hypothesis.settings.load_profile("rsenf")
ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data"
# Files that take a minute and more. They begin first, so that at the end no core waits for another.
LONGEST = (
    "tests/test_readme.py",
    "tests/cli/test_mistaken_input.py",
    "tests/cli/test_verify_measured.py",
    "tests/discrepancy/test_on_foreign_lamps.py",
    "tests/discrepancy/test_short_recordings.py",
    "tests/run/test_node_kinds.py",
    "tests/discrepancy/test_discover.py",
    "tests/discrepancy/test_by_ffmpeg.py",
    "tests/api/test_unknown_rate.py",
    "tests/cli/test_init.py",
    "tests/cli/test_graph_results.py",
    "tests/run/test_restarts.py",
    "tests/api/test_same_as_cli.py",
    "tests/run/test_same_as_one_process.py",
    "tests/discrepancy/test_watch.py",
    "tests/run/test_how_runs_end.py",
    "tests/flicker/test_frame_slips.py",
    "tests/discrepancy/test_heterogeneity.py",
    "tests/track/test_projection.py",
    "tests/cli/test_results.py",
    "tests/cli/test_discover_resumes.py",
    "tests/match/test_mistaken_clips.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the longest files begin."""
    place = {ROOT / path: number for number, path in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


@pytest.hookimpl(wrapper=True)
def pytest_timeout_set_timer(settings: Any) -> Generator[None, Any, Any]:
    """Let the time limit of a test be longer where the machine turns out to be slow."""
    patience = Patience(settings.timeout)
    told = yield
    ring = signal.getsignal(signal.SIGALRM)

    def rung(number: int, frame: FrameType | None) -> None:
        if patience.over:
            ring(number, frame)
        else:
            signal.setitimer(signal.ITIMER_REAL, patience.left_s)

    signal.signal(signal.SIGALRM, rung)
    return told


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Folder of the measured data; skips where it isn't there."""
    if not DATA.is_dir():
        pytest.skip("the measured data (../shared/data) is not here")
    return DATA


@pytest.fixture(scope="session")
def rsenf() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line as a user would: ``rsenf("track", path)``."""

    def run(*words: object, **more: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(  # type: ignore[call-overload, no-any-return]  # kwargs passed on
            [sys.executable, "-m", "rsenf.cli", *map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            **more,
        )

    return run


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated 45 s clip of 320 × 240, H.264 at good quality, its truth beside it."""
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    words = ["simulate", "--out", path, "--duration-s", "45", "--size", "320x240", "--seed", "11"]
    subprocess.run([sys.executable, "-m", "rsenf.cli", *map(str, words)], check=True)
    return path


@pytest.fixture(scope="session")
def hidden(tmp_path_factory: pytest.TempPathFactory) -> HiddenClip:
    """Two minutes of rows, hidden in a two-hour reference."""
    return hide_clip(tmp_path_factory.mktemp("hidden"))


@pytest.fixture(scope="session")
def recording(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An MCAP recording of the clip's way through separate processes: decode, rows and track."""
    folder = tmp_path_factory.mktemp("recording")
    graph = folder / "graph.yaml"
    graph.write_text(
        "version: 1\nsite: test\nnodes:\n"
        f'  decode: {{kind: decode, camera: cam1, input: "{clip}"}}\n'
        "  rows: {kind: rows, cameras: [cam1]}\n"
        "  track: {kind: track, cameras: [cam1]}\n"
        f'  record: {{kind: record, out: "{folder / "cam1.mcap"}"}}\n'
    )
    words = [sys.executable, "-m", "rsenf.cli", "run", graph, "--quiet"]
    subprocess.run([*map(str, words)], check=True)
    return folder / "cam1.mcap"
