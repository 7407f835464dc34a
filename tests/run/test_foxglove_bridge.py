"""What is sent arrives at a WebSocket client that speaks Foxglove's protocol."""

from __future__ import annotations

import json
import struct

import pytest
from run_samples import block

from rsenf.errors import RsenfError, UsageError
from rsenf.messages import Header, VideoPacket, encode
from rsenf.run.foxglove_bridge import FoxgloveBridge

NOW_NS = 1_790_000_000_000_000_000
ROWS, VIDEO = "rsenf/lab/cam/rows", "rsenf/lab/cam/video"


def send(bridge, topic, message):
    bridge.send(topic, message, encode(message))


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    with pytest.raises(UsageError, match="foxglove-sdk") as refused:
        FoxgloveBridge("127.0.0.1", 0, "x", lambda: NOW_NS)
    assert "rsenf[foxglove]" in refused.value.hint


def test_messages_reach_a_client():
    pytest.importorskip("foxglove", reason="foxglove-sdk isn't installed")
    client = pytest.importorskip("websockets.sync.client", reason="websockets isn't installed")
    packet = VideoPacket(
        header=Header(source="lab/cam", arrival_time_ns=NOW_NS), codec="h264", data=b"picture"
    )
    with FoxgloveBridge("127.0.0.1", 0, "rsenf lab", lambda: NOW_NS) as bridge:
        send(bridge, ROWS, block(0))
        send(bridge, VIDEO, packet)
        with client.connect(
            f"ws://127.0.0.1:{bridge.port}", subprotocols=["foxglove.sdk.v1"]
        ) as socket:
            channels = advertised(socket)
            assert {c["topic"]: c["schemaName"] for c in channels} == {
                ROWS: "rsenf.RowBlock",
                VIDEO: "foxglove.CompressedVideo",
            }
            wanted = [{"id": c["id"], "channelId": c["id"]} for c in channels]
            socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            topics = {c["id"]: c["topic"] for c in channels}
            got = {}
            for _ in range(50):  # until the server has taken note of the subscription
                send(bridge, ROWS, block(1))
                send(bridge, VIDEO, packet)
                got |= data_of(socket, topics)
                if len(got) == 2:
                    break
    assert got[ROWS] == (NOW_NS, encode(block(1)))
    assert b"picture" in got[VIDEO][1]


def advertised(socket):
    found = []
    while len(found) < 2:
        said = json.loads(socket.recv())
        if said["op"] == "advertise":
            found += said["channels"]
    return found


def data_of(socket, topics):
    try:
        said = socket.recv(timeout=0.2)
    except TimeoutError:
        return {}
    if not isinstance(said, bytes) or said[0] != 1:
        return {}
    number, log_time_ns = struct.unpack_from("<IQ", said, 1)
    return {topics[number]: (log_time_ns, said[13:])}


def test_a_port_that_is_taken_is_said_in_a_line():
    pytest.importorskip("foxglove", reason="foxglove-sdk isn't installed")
    with (
        FoxgloveBridge("127.0.0.1", 0, "x", lambda: NOW_NS) as bridge,
        pytest.raises(RsenfError, match=f"can't serve at 127.0.0.1:{bridge.port}"),
    ):
        FoxgloveBridge("127.0.0.1", bridge.port, "x", lambda: NOW_NS)
