"""The layout names topics and fields that the demo records, and every panel has its place."""

from __future__ import annotations

import json
import re
from pathlib import Path

from rsenf.api.demo import GRAPH
from rsenf.bus.keys import TOPICS, topic_of
from rsenf.messages.schema import field_specs, message_classes

LAYOUT = Path(__file__).resolve().parents[2] / "configs" / "foxglove-layout.json"


def paths_in(config):
    yield from (path["value"] for path in config.get("paths", ()))
    if "topicPath" in config:
        yield config["topicPath"]


def panels_in(node):
    if isinstance(node, str):
        return [node]
    assert node["direction"] in ("row", "column")
    return panels_in(node["first"]) + panels_in(node["second"])


def test_every_panel_is_laid_out_once():
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    assert sorted(panels_in(layout["layout"])) == sorted(layout["configById"])
    kinds = {name.partition("!")[0] for name in layout["configById"]}
    assert kinds == {"Image", "Plot", "RawMessages"}


def test_every_path_is_a_field_of_its_topic():
    for config in json.loads(LAYOUT.read_text(encoding="utf-8"))["configById"].values():
        for path in paths_in(config):
            topic, _, fields = path.partition(".")
            cls = TOPICS[topic_of(re.sub(r"\{.*\}", "", topic))]
            for name, selected in re.findall(r"(\w+)(\[:\])?", fields):
                (spec,) = [spec for spec in field_specs(cls) if spec.name == name]
                assert bool(selected) == (spec.kind in ("array", "repeated")), path
                cls = message_classes().get(spec.wire)


def test_topics_are_those_of_the_demo():
    text = LAYOUT.read_text(encoding="utf-8")
    assert "site: demo" in GRAPH
    assert "camera: cam1" in GRAPH
    assert set(re.findall(r"rsenf/[\w/]+", text)) == {
        "rsenf/demo/reference/demo",
        *(f"rsenf/demo/cam1/{topic}" for topic in ("video", "track", "idle", "match")),
    }
