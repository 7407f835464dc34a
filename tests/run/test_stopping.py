"""Ctrl-C and its like: everything ends within two seconds, the recording is whole."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from conftest import Film, Graphs
from live_run import LiveRun
from run_samples import children_of

from rsenf.errors import EXIT_DONE, EXIT_INTERRUPTED
from rsenf.record import open_recording

pytestmark = pytest.mark.processes

NODES = ("decode", "rows", "track", "match", "record")
# Two seconds are promised, and measured in the report. On a loaded machine the nodes get as long
# as they took to start, so that a recording isn't cut short for its sake.
PROMISED_S = 2.0


def prompt_s(start_s: float) -> float:
    """Return the longest that stopping may take here, after a start that took so long."""
    return 2.0 * max(PROMISED_S, start_s)


def assert_whole(path: Path, *, ended: bool = True) -> None:
    """A closed recording, each of its streams numbered without a gap and marked as ended."""
    recording = open_recording(path)
    assert recording.complete
    streams: dict[str, list[object]] = {}
    for topic, message, _ in recording.messages():
        if "@nodes" not in topic:
            streams.setdefault(topic.split("/")[-1], []).append(message.header)
    for headers in streams.values():
        numbers = [h.seq for h in headers]  # type: ignore[attr-defined]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    if ended:
        assert set(streams) >= {"frames", "video", "rows", "track", "match"}
        assert all(h[-1].is_end for h in streams.values())  # type: ignore[attr-defined]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("pace", [True, False])
def test_a_run_that_is_interrupted(
    film: Film, graphs: Graphs, live_run: type[LiveRun], number: signal.Signals, pace: bool
) -> None:
    run = live_run(graphs.write(film, pace=pace)).until("running", *NODES).until("done", "grid")
    took_s = run.interrupt(number)
    print(f"{number.name}, {'paced' if pace else 'at full speed'}: {took_s:.2f} s")
    assert run.process.returncode == EXIT_DONE
    assert run.error == "rsenf: stopped"
    assert took_s < prompt_s(run.ready_s)
    assert run.left == []
    assert not any(s in ("lost", "failed") for states in run.states.values() for s in states)
    assert_whole(graphs.out)


def test_a_run_that_is_interrupted_while_it_starts(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    begun = time.monotonic()
    run = live_run(graphs.write(film, pace=True))
    while not run.run_id or not run.left:
        assert run.process.poll() is None
    begun_s = time.monotonic() - begun
    took_s = run.interrupt()
    print(f"while starting: {took_s:.2f} s")
    assert took_s < prompt_s(begun_s)
    assert run.process.returncode in (EXIT_DONE, EXIT_INTERRUPTED)
    assert run.left == []
    assert not any("Traceback" in line for line in run.lines)


def test_a_second_interrupt_ends_at_once(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    run = live_run(graphs.write(film, pace=True)).until("running", *NODES)
    os.kill(run.pids["track"], signal.SIGSTOP)  # so that stopping in order takes its time
    run.process.send_signal(signal.SIGINT)
    run.until("done", "decode")
    took_s = run.interrupt()
    assert run.process.returncode == EXIT_INTERRUPTED
    assert run.error == "rsenf: interrupted"
    assert took_s < prompt_s(run.ready_s)


def test_a_node_that_hangs_is_ended_in_time(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    run = live_run(graphs.write(film, pace=True)).until("running", *NODES)
    os.kill(run.pids["track"], signal.SIGSTOP)
    took_s = run.interrupt()
    print(f"with a node that hangs: {took_s:.2f} s")
    assert took_s < prompt_s(run.ready_s)
    assert run.process.returncode == 1
    assert run.error == "rsenf: track: did not stop in time and was killed"
    recording = open_recording(graphs.out)
    assert recording.complete


IN_A_TERMINAL = """
import pty, sys
sys.exit(pty.spawn(sys.argv[1:]) >> 8)
"""


def test_control_c_in_a_terminal(film: Film, graphs: Graphs) -> None:
    """The terminal signals its whole process group: the nodes aren't in it, but told in order."""
    graph = graphs.write(film, pace=True)
    words = [sys.executable, "-m", "rsenf.cli", "run", str(graph)]
    terminal = subprocess.Popen(
        [sys.executable, "-c", IN_A_TERMINAL, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
    )
    assert terminal.stdin is not None
    assert terminal.stdout is not None
    seen, begun = b"", time.monotonic()
    while not all(re.search(rb"%s[^\r\n]*running" % name.encode(), seen) for name in NODES):
        seen += os.read(terminal.stdout.fileno(), 65536)
    run_id = seen.split(b"run ")[1][:8].decode()
    start_s, begun = time.monotonic() - begun, time.monotonic()
    terminal.stdin.write(b"\x03")
    terminal.stdin.flush()
    while more := os.read(terminal.stdout.fileno(), 65536):
        seen += more
    code, took_s = terminal.wait(20), time.monotonic() - begun
    terminal.communicate()
    print(f"in a terminal: {took_s:.2f} s")
    assert code == 0, seen[-2000:].decode(errors="replace")
    assert seen.rstrip().endswith(b"rsenf: stopped")
    assert b"\x1b[?25h" in seen.split(b"\x1b[?25l")[-1]  # the cursor is back
    assert took_s < prompt_s(start_s)
    assert children_of(run_id) == []
    assert_whole(graphs.out)


def test_a_recording_from_outside_that_is_interrupted(
    film: Film, graphs: Graphs, live_run: type[LiveRun], tmp_path: Path
) -> None:
    run = live_run(graphs.write(film, pace=True)).until("running", *NODES)
    out = tmp_path / "other.mcap"
    words = ["record", "--connect", run.endpoint, "--out", str(out), "--json"]
    recording = subprocess.Popen(
        [sys.executable, "-m", "rsenf.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not out.exists() or out.stat().st_size < 100_000:
        assert recording.poll() is None
        time.sleep(0.02)
    begun = time.monotonic()
    recording.send_signal(signal.SIGINT)
    printed, errors = recording.communicate()
    took_s = time.monotonic() - begun
    print(f"rsenf record: {took_s:.2f} s")
    assert recording.returncode == EXIT_DONE, errors
    assert took_s < prompt_s(run.ready_s)
    assert '"missed": 0' in printed
    assert_whole(out, ended=False)
    assert run.interrupt() < prompt_s(run.ready_s)  # the run itself went on
    assert run.process.returncode == EXIT_DONE
    assert_whole(graphs.out)


WITHIN_ITS_OWN_WAIT = """\
import os, signal, sys
from types import SimpleNamespace
from threading import Event
from rsenf.run.node import install_signals
from rsenf.run.process import hangups, interruptible
def heard(event, number):
    with event._cond:  # as Event.wait has it where it begins and ends
        os.kill(os.getpid(), number)
    assert event.wait(60.0)
with hangups() as asked, interruptible(sys.exit) as stop:
    heard(stop, signal.SIGINT)
    heard(asked, signal.SIGHUP)
node = SimpleNamespace(stop=Event())
install_signals(node)
heard(node.stop, signal.SIGTERM)
"""


def test_a_signal_within_the_wait_for_it_hangs_nothing() -> None:
    subprocess.run([sys.executable, "-c", WITHIN_ITS_OWN_WAIT], check=True, timeout=60.0)


HANGING_UP = """\
import signal, sys, time
from rsenf.run.process import hangups, interruptible
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
with hangups() as asked, interruptible(sys.exit) as stop:
    print("begun", flush=True)
    while not (stop.is_set() or asked.is_set()):
        time.sleep(0.01)
    if stop.is_set():
        print("stopping", flush=True)
        signal.sigwait({signal.SIGUSR1})
sys.exit(10 if stop.is_set() else 11)
"""


@pytest.mark.parametrize("closes", [True, False])
def test_a_terminal_that_closes_is_a_wish_to_stop_wherever_the_words_go(closes: bool) -> None:
    ours, theirs = pty.openpty()
    told, tells = os.pipe()

    def take_terminal() -> None:
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        [sys.executable, "-c", HANGING_UP],
        stdin=theirs, stdout=tells, stderr=subprocess.DEVNULL, preexec_fn=take_terminal,
    )  # fmt: skip
    os.close(theirs)
    os.close(tells)
    with open(told) as words:
        assert words.readline() == "begun\n"
        if closes:
            os.close(ours)
            assert words.readline() == "stopping\n"
            process.send_signal(signal.SIGHUP)  # a shell sends it, too
            process.send_signal(signal.SIGUSR1)
        else:
            process.send_signal(signal.SIGHUP)
    assert process.wait(60.0) == (10 if closes else 11)
