"""A recording opens with the mcap library of another language, by the schemas inside it."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from rsenf.messages import EnfEstimate, VideoPacket
from rsenf.record import open_recording

READER = Path(__file__).with_name("read_by_javascript.cjs")
GOLDEN = Path(__file__).parents[2] / "recordings" / "still_2997.mcap"
NEEDED = ("@mcap/core", "@mcap/nodejs", "@mcap/support", "protobufjs")


def test_every_message_and_number_is_the_same() -> None:
    node = shutil.which("node")
    asked = [node or "", "--eval", f"{json.dumps(NEEDED)}.map(require)"]
    if not node or subprocess.run(asked, cwd=READER.parent, capture_output=True).returncode:
        pytest.skip(f"needs Node.js and its packages {', '.join(NEEDED)} (NODE_PATH)")
    done = subprocess.run([node, READER, GOLDEN], capture_output=True, text=True, check=True)
    read = json.loads(done.stdout)
    ours = list(open_recording(GOLDEN).messages())
    # The end of a video is a line of its index, not a picture.
    counts = Counter(
        topic for topic, m, _ in ours if not (isinstance(m, VideoPacket) and m.header.mark)
    )
    assert {t: n for t, n in read["messages"].items() if not t.endswith("/index")} == counts
    enf_hz = [m.enf_hz for _, m, _ in ours if isinstance(m, EnfEstimate) and m.points]
    assert len(enf_hz) > 10
    assert read["enf_hz"] == enf_hz
