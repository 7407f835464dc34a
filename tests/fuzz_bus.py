"""What listens on a bus, for the fuzz: messages in files, and all that takes them."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parent / "record"))

from record_samples import NOW_NS, header, random_message

from rsenf.bus.frames import FrameReceiver
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import ROOT, SIGNALS, TOPICS, camera_key, health_key, reference_key, topic_of
from rsenf.bus.sequence import Envelope
from rsenf.dashboard.app import Session
from rsenf.dashboard.site import Site, Wiring
from rsenf.errors import NodeFailed, RsenfError, SchemaMismatch
from rsenf.idle.estimator_state import IdleSettings
from rsenf.live import Live
from rsenf.match.stage import Match
from rsenf.messages import Frame, encode, encoding_of
from rsenf.record import open_recording
from rsenf.rows.settings import RowsSettings
from rsenf.run.runner import Pipeline
from rsenf.run.stages import flicker_stages, live_stage, match_stage, rows_stage
from rsenf.track.method import TrackSettings
from tests.golden.make import FOLDER
from tests.loopback import Loopback

FRAMES = 90  # of the golden recording


def make_messages(folder: Path) -> None:
    """A file for each message: of the stages, and one of every topic with anything in it."""
    size = {"height_px": 24, "width_px": 32, "pixels": bytes(range(96)) * 8}
    sent: list[Any] = [("frames", Frame(header=header(seq), **size)) for seq in range(20)]
    for key, message, _ in open_recording(FOLDER / "weak_cfl.mcap").messages():
        topic = "reference" if "reference" in key else key.rpartition("/")[2]
        if topic != "video" and message.header.frame_last < FRAMES:
            sent.append((topic, message))
    others = TOPICS.keys() - {topic for topic, _ in sent}
    sent += [(topic, random_message(TOPICS[topic], 1, header(0))) for topic in sorted(others)]
    for number, (topic, message) in enumerate(sent):
        (folder / f"{number:03}.{topic}").write_bytes(encode(message))


def take_messages(folder: Path) -> None:
    """Everything that listens: inbox, stages, and the dashboard."""
    network, inbox, refused = Loopback(), Inbox(), ""
    network.bus("listener").subscribe(inbox, f"{ROOT}/**", SIGNALS)
    for path in sorted(folder.iterdir()):
        topic = path.suffix[1:]
        key = camera_key("golden", "cam", topic)
        if topic in ("reference", "health"):
            key = {"reference": reference_key, "health": health_key}[topic]("golden", "grid")
        envelope = Envelope(key, encoding_of(TOPICS[topic]), path.read_bytes(), "sender")
        network.bus("sender").publisher(key, SIGNALS)._put(envelope)
    site = Site(Wiring({"golden/cam": ["n"]}), lambda: NOW_NS)
    session = Session(site)
    session.ask(json.dumps({"feed": "golden/cam"}))
    judged = ("rows", "track", "idle", "reference")
    pipelines = {
        ("frames",): Pipeline([rows_stage(RowsSettings())], ("frames",)),
        ("rows",): Pipeline(flicker_stages(TrackSettings(), IdleSettings()), ("rows",)),
        judged: Pipeline([match_stage(lambda: Match(grid="grid")), live_stage(Live)], judged),
    }
    frames = FrameReceiver()
    while received := inbox.receive(0):
        topic, message = topic_of(received.key), received.message
        site.update(received.key, message)
        try:
            if topic == "frames":
                message = frames.open(message)
            for topics, pipeline in pipelines.items():
                if topic in topics:
                    pipeline.feed(topic, message)
        except (SchemaMismatch, NodeFailed) as exc:  # which end no node
            refused = str(exc)
        except RsenfError as exc:
            raise RuntimeError(f"a node would end: {exc!r}") from exc
    json.loads(session.news())
    if refused or inbox.counters.rejected:
        raise RsenfError(refused or "rejected")


def ask(folder: Path) -> None:
    """What a browser asks the dashboard."""
    session = Session(Site(Wiring({"lab/cam": ["n"]}), lambda: NOW_NS))
    session.ask((folder / "asked.json").read_text(errors="replace"))
    json.loads(session.news())
