"""What Zenoh leaves to its user: standstill, exits that hang, words for what goes wrong."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from bus_samples import TRACK, client, drain, estimate, frame, router, seqs, take

from rsenf.bus import zenoh_bus
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import SIGNALS
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus, setting_problem
from rsenf.errors import RsenfError, UsageError
from rsenf.messages import encode, encoding_of
from rsenf.run.process import wait_until

HERE = str(Path(__file__).parent)


def test_foreign_messages_over_the_wire_are_counted_and_the_receiver_lives() -> None:
    with router() as (endpoint, bus), client(endpoint) as other:
        inbox = Inbox()
        bus.subscribe(inbox, "rsenf/**", SIGNALS)
        raw, good = other._session, estimate(0)
        payload, encoding = encode(good), encoding_of(type(good))
        raw.put(TRACK, b"hello")
        raw.put(TRACK, payload, encoding="text/plain")
        raw.put(TRACK, payload[:-1], encoding=encoding)
        raw.put(TRACK, payload, encoding=encoding.replace("/1", "/2"))
        raw.put("rsenf/a", b"", attachment=b"\xff\xfe")
        raw.delete(TRACK)
        raw.put(TRACK, payload, encoding=encoding)  # from a stranger who speaks our language
        assert seqs(take(inbox, 1)) == [0]
        assert inbox.counters.rejected == 6
        other.publisher(TRACK, SIGNALS).send(estimate(0))
        assert seqs(take(inbox, 1)) == [0]


def test_an_unreachable_bus_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_bus, "CONNECT_TIMEOUT_MS", 100)
    endpoint = free_endpoint()
    with pytest.raises(RsenfError, match=f"no bus at {endpoint}") as caught, client(endpoint):
        pass
    assert caught.value.hint
    assert "\n" not in str(caught.value)


def test_an_address_that_is_taken_or_nonsense_is_one_clear_line() -> None:
    with (
        router() as (endpoint, _),
        pytest.raises(RsenfError, match="no bus can be opened at") as caught,
        open_bus(BusSettings(mode="router", listen=(endpoint,))),
    ):
        pass
    assert "\n" not in str(caught.value)
    with pytest.raises(RsenfError, match="nonsense"), client("nonsense"):
        pass


def test_what_is_no_key_expression_is_one_clear_line() -> None:
    with router() as (_, bus), pytest.raises(UsageError, match="no key expression"):
        bus.subscribe(Inbox(), "rsenf//x", SIGNALS)


def test_a_setting_that_is_none_is_named_without_its_value() -> None:
    assert setting_problem("transport/auth/usrpwd/password", "hunter2") == ""
    assert setting_problem("transport/link/tx/batch_size", 1000) == ""
    with (
        pytest.raises(UsageError, match="bus setting transport/auth/pasword") as caught,
        open_bus(BusSettings(zenoh={"transport/auth/pasword": "hunter2"})),
    ):
        pass
    assert "hunter2" not in str(caught.value)


def test_wrong_credentials_are_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zenoh_bus, "CONNECT_TIMEOUT_MS", 300)
    users = tmp_path / "users"
    users.write_text("bob:right\n", encoding="utf-8")
    path = "transport/auth/usrpwd"
    endpoint = free_endpoint()
    login = {f"{path}/user": "bob", f"{path}/password": "right"}
    asks = {**login, f"{path}/dictionary_file": str(users)}
    with open_bus(BusSettings(mode="router", listen=(endpoint,), zenoh=asks)) as bus:
        inbox = Inbox()
        bus.subscribe(inbox, TRACK, SIGNALS)
        with open_bus(BusSettings(connect=(endpoint,), zenoh=login)) as other:
            other.publisher(TRACK, SIGNALS).send(estimate(0))
            assert seqs(take(inbox, 1)) == [0]
        login[f"{path}/password"] = "wrong"
        with (
            pytest.raises(RsenfError, match="password accepted") as caught,
            open_bus(BusSettings(connect=(endpoint,), zenoh=login)),
        ):
            pass
        assert "wrong" not in str(caught.value)


EXITING = """
import sys, threading
sys.path.insert(0, {here!r})
from bus_samples import *
from rsenf.bus.keys import SIGNALS
with router() as (endpoint, bus), client(endpoint) as other:
    inbox = Inbox()
    bus.subscribe(inbox, "rsenf/**", SIGNALS)
    bus.watch_alive("rsenf/**", lambda key, alive: None)
    other.declare_alive("rsenf/lab/@nodes/a/alive")
    publisher = other.publisher(TRACK, SIGNALS)
    {body}
"""


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("take_one = take(inbox, 0)", 0),
        ("publisher.send(estimate(0)); take(inbox, 1); raise SystemExit(7)", 7),
        ("raise ValueError('as in a node that goes wrong')", 1),
        # A reader that never reads, and a sender in another thread that waits for it.
        (
            "threading.Thread(target=lambda: [publisher.send(estimate(k)) for k in range(9999)])"
            ".start()\n    take(inbox, 1); raise ValueError('while somebody waits')",
            1,
        ),
        ("import signal, os; os.kill(os.getpid(), signal.SIGINT)", -2),
    ],
)
def test_the_interpreter_exits_whatever_happens(body: str, code: int) -> None:
    program = EXITING.format(here=HERE, body=body)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr


RELAY = """
import sys
sys.path.insert(0, {here!r})
from bus_samples import *
from rsenf.bus.keys import *
what, endpoint, cameras, count = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
with client(endpoint) as bus:
    if what == "send":
        publisher = bus.publisher("rsenf/lab/c" + sys.argv[5] + "/frames", FRAMES_FILE)
        sys.stdin.readline()
        for seq in range(count):
            publisher.send(Frame(header=Header(run_id="r", seq=seq), pixels=bytes(20_000)))
        sys.stdin.readline()
    else:
        topic, few = ("frames", FRAMES_FILE) if what == "relay" else ("rows", ROWS)
        inbox, out = Inbox(), {{}}
        for camera in range(cameras):
            bus.subscribe(inbox, f"rsenf/lab/c{{camera}}/{{topic}}", few)
            out[camera] = bus.publisher(f"rsenf/lab/c{{camera}}/rows", ROWS)
        print("ready", flush=True)
        for _ in range(cameras * count):
            received = next_of(inbox)
            if what == "relay":
                camera, seq = int(received.key.split("/")[2][1:]), received.message.header.seq
                level = np.zeros((1, 400, 2), np.float32)
                header = Header(run_id="r", seq=seq, frame_first=seq, frame_last=seq)
                number, kept = np.array([seq]), np.ones((400, 2), np.uint32)
                out[camera].send(RowBlock(header=header, frames=1, rows=400, strips=2, level=level,
                                          frame_number=number, frame_pts_ns=0 * number,
                                          kept_px=kept, read_out_axis="rows"))
            else:
                time.sleep(0.001)
        print(inbox.counters.missed, flush=True)
        sys.stdin.readline()
"""


@pytest.mark.processes
def test_many_senders_to_a_slow_chain_never_stand_still() -> None:
    """Several cameras' frames to one node, whose row blocks go to a slower one, all lossless.

    Receiving threads of the router wait with the frames in their hands. If all did, the row
    blocks that would make room could not come in.
    """
    cameras, count = 4, 800
    imports = "import time, numpy as np\nfrom rsenf.messages import Frame, Header, RowBlock\n"
    program = imports + RELAY.format(here=HERE)

    def start(program: str, *words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-c", program, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    routing = (
        f"import sys; sys.path.insert(0, {HERE!r})\nfrom bus_samples import *\n"
        "with router() as (endpoint, bus): print(endpoint, flush=True); sys.stdin.readline()"
    )
    hub = start(routing)
    assert hub.stdout is not None
    endpoint = hub.stdout.readline().strip()
    words = (endpoint, str(cameras), str(count))
    readers = [start(program, "relay", *words), start(program, "read", *words)]
    senders = [start(program, "send", *words, str(camera)) for camera in range(cameras)]
    everybody = [*senders, *readers, hub]
    try:
        for reader in readers:
            assert reader.stdout is not None
            assert reader.stdout.readline() == "ready\n"
        for sender in senders:
            assert sender.stdin is not None
            sender.stdin.write("go\n")
            sender.stdin.flush()
        for reader in reversed(readers):
            assert reader.stdout is not None
            assert reader.stdout.readline() == "0\n"  # nothing missed; it doesn't say so if stuck
    finally:
        for process in everybody:
            process.kill()
            process.communicate()


def test_nothing_waits_after_the_bus_is_closed() -> None:
    with router() as (_, bus):
        inbox = Inbox()
        bus.subscribe(inbox, TRACK, SIGNALS)
    assert inbox._closed
    assert drain(inbox) == []


@pytest.mark.parametrize(
    ("settings", "lease_ms"),
    [
        (BusSettings(connect=("tcp/127.0.0.1:7447",)), zenoh_bus.LOCAL_LEASE_MS),
        (BusSettings(mode="router", listen=("tls/[::1]:7447",)), zenoh_bus.LOCAL_LEASE_MS),
        (BusSettings(connect=("tcp/10.0.0.7:7447",)), zenoh_bus.LEASE_MS),
        (
            BusSettings(mode="router", listen=("tcp/127.0.0.1:7447", "tcp/0.0.0.0:7448")),
            zenoh_bus.LEASE_MS,
        ),
        (BusSettings(multicast=True), zenoh_bus.LEASE_MS),
    ],
)
def test_within_a_host_no_silent_link_is_given_up(settings: BusSettings, lease_ms: int) -> None:
    config = zenoh_bus._config(settings)
    assert int(config.get_json("transport/link/tx/lease")) == lease_ms


def test_readers_that_leave_under_backpressure_hold_nobody_up() -> None:
    """A router that sends to a session just being closed may block: a reader unsubscribes first."""
    narrow, enough, sent = replace(SIGNALS, queue=2, history=0), threading.Event(), Counter[str]()
    keys = [f"rsenf/lab/cam{n}/frames" for n in range(3)]
    with router() as (endpoint, _), client(endpoint) as sending:

        def send(key: str) -> None:
            publisher = sending.publisher(key, narrow)
            while not enough.is_set():
                publisher.send(frame(sent[key], 200, 300))
                sent[key] += 1

        senders = [threading.Thread(target=send, args=(key,), daemon=True) for key in keys]
        for sender in senders:
            sender.start()
        for _ in range(15):
            with client(endpoint) as leaving:
                slow = Inbox()
                leaving.subscribe(slow, "rsenf/lab/*/frames", narrow)
                take(slow, 1)  # and no more: the senders wait for it
                time.sleep(0.3)  # until the queues to it are full
            before = sent.copy()
            assert wait_until(lambda: all(sent[key] > before[key] for key in keys))  # noqa: B023
        enough.set()
        assert wait_until(lambda: not any(sender.is_alive() for sender in senders))
