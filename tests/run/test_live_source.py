"""A camera on the network in a graph: live, lost, back under a new epoch, stopped cleanly."""

from __future__ import annotations

from pathlib import Path

import pytest
from live_run import LiveRun

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.errors import EXIT_LOSS
from rsenf.messages import Header
from rsenf.record import open_recording
from rsenf.run.process import Patience
from tests.decode import rtsp_server
from tests.decode.rtsp_server import RtspServer
from tests.in_time import in_time

pytestmark = [pytest.mark.processes, pytest.mark.external]

GRAPH = """\
version: 1
site: lab
nodes:
  decode: {{kind: decode, camera: cam, input: "{url}", threads: 1, frames: {frames}}}
  {rows}
  track:  {{kind: track, cameras: [cam]}}
  record: {{kind: record, out: "{out}"}}
"""
ROWS = "rows: {kind: rows, cameras: [cam]}"


def until_rows(inbox: Inbox, epoch: int, count: int) -> list[Header]:
    """Headers of row blocks up to the ``count``-th of an epoch."""
    seen: list[Header] = []
    while sum(h.epoch == epoch for h in seen) < count:
        received, patience = None, Patience(40)
        while received is None:
            assert not patience.over
            received = inbox.receive(0.5)
        seen.append(received.message.header)
    return seen


@pytest.mark.parametrize("frames", ["ring", "fused"])
def test_a_camera_that_goes_and_comes_back(
    tmp_path: Path, live_run: type[LiveRun], frames: str
) -> None:
    if lacking := rtsp_server.missing():
        pytest.skip(lacking)
    path, out, inbox = tmp_path / "g.yaml", tmp_path / "o.mcap", Inbox()
    with RtspServer() as server:
        rows = ROWS if frames == "ring" else ""
        path.write_text(GRAPH.format(url=server.url, out=out, frames=frames, rows=rows))
        run = live_run(path).until("running", "decode", "track", "record")
        with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
            bus.subscribe(inbox, camera_key("lab", "cam", "rows"), LOOKING)
            until_rows(inbox, epoch=0, count=5)
            server.kill()
            with RtspServer(port=server.port):
                seen = until_rows(inbox, epoch=1, count=8)
                took_s = run.interrupt()
    print(f"{frames}: stopped in {took_s:.2f} s")
    assert run.process.returncode == EXIT_LOSS  # the source was lost for a while
    assert in_time(took_s, 4)
    assert run.left == []
    said = "\n".join(run.lines)
    assert "connected" in said
    assert "next attempt in" in said
    assert "Traceback" not in said
    # Each epoch is numbered from 0 on, and the second follows the first for good. Blocks may be
    # missing: their frames came in a burst too quick for this machine, and were dropped.
    epochs = [h.epoch for h in seen]
    assert epochs == sorted(epochs)
    numbers = [h.seq for h in seen if h.epoch == 1]
    assert numbers == sorted(set(numbers))
    assert numbers[0] < 4
    recording = open_recording(out)
    assert recording.complete
    recorded: dict[tuple[str, int], list[int]] = {}
    for topic, message, _ in recording.messages():
        key = topic.split("/")[-1], message.header.epoch
        recorded.setdefault(key, []).append(message.header.seq)
    for epoch in (0, 1):
        numbers = recorded["video", epoch]
        assert numbers == list(range(len(numbers)))
        numbers = recorded["rows", epoch]
        assert numbers == sorted(set(numbers))
        assert len(numbers) >= 5
