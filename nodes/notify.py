"""Notify: sends alarms to people, by a program, a webhook, MQTT or e-mail."""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Iterator
from datetime import time
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, field_validator

from rsenf.config.node_kind import NodeKind, Problem, Strict, bad_key_expressions
from rsenf.errors import UsageError

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.run.node import NodeProcess


class Target(Strict):
    """Who is told of which alarms."""

    cameras: tuple[str, ...] = Field(("*",), description="patterns, as of file names")
    kinds: tuple[str, ...] = Field(("*",), description="patterns: stale, frozen, lost, …")
    severity: Literal["info", "warning", "alarm"] = Field("warning", description="the least")
    quiet_from: time | None = Field(None, description="no new alarm from here, local time, …")
    quiet_until: time | None = Field(None, description="… to here")

    @field_validator("quiet_from", "quiet_until", mode="before")
    @classmethod
    def _is_local(cls, value: object) -> object:
        """Refuse what YAML has made a number of, and a time zone."""
        if re.fullmatch(r"\d\d:\d\d(:\d\d)?|None", str(value)):
            return value
        raise ValueError('write a local time in quotes, as "22:00"')


class ProgramTarget(Target):
    """A program that gets the alarm as JSON on its standard input."""

    via: Literal["exec"]
    command: tuple[str, ...] = Field(min_length=1)
    limit_s: float = Field(30.0, gt=0, description="after which it is killed, and tried again")


class WebhookTarget(Target):
    """An address that the alarm is posted to as JSON."""

    via: Literal["webhook"]
    url: str = Field(pattern="^https?://")
    secret_env: str | None = Field(
        None, description="variable with the key of the HMAC-SHA256 in X-Rsenf-Signature"
    )


class MqttTarget(Target):
    """A broker; Home Assistant finds each alarm as a binary sensor."""

    via: Literal["mqtt"]
    host: str
    port: int = Field(1883, ge=1, le=65535)
    tls: bool = False
    topic: str = Field("rsenf", description="prefix of the topics")
    discovery: str | None = Field("homeassistant", description="prefix of Home Assistant's")
    user: str | None = None
    password_env: str | None = Field(None, description="variable with the password")


class EmailTarget(Target):
    """Addresses that get a mail."""

    via: Literal["email"]
    to: tuple[str, ...] = Field(min_length=1)
    sender: str
    host: str
    port: int = Field(587, ge=1, le=65535)
    starttls: bool = True
    user: str | None = None
    password_env: str | None = Field(None, description="variable with the password")


AnyTarget = Annotated[
    ProgramTarget | WebhookTarget | MqttTarget | EmailTarget, Field(discriminator="via")
]


class NotifyNode(NodeKind):
    """Sends alarms to people: one message when each begins, and one when it is over."""

    kind: Literal["notify"]
    queue: str = Field(description="file of what is not sent yet; survives a restart")
    to: tuple[AnyTarget, ...] = Field(min_length=1, description="who is told")
    topics: tuple[str, ...] = Field(("*/alarm",), description="key expressions below the site")

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield invalid key expressions, and a missing package."""
        yield from bad_key_expressions(("topics", key_expr) for key_expr in self.topics)
        if any(t.via == "mqtt" for t in self.to) and importlib.util.find_spec("paho") is None:
            yield ("to",), "MQTT needs the package paho-mqtt; pip install 'rsenf[notify]'"
        for target in self.to:
            if (target.quiet_from is None) != (target.quiet_until is None):
                yield ("to",), "quiet_from and quiet_until go together"

    def check_ready(self, name: str, site: str) -> None:
        """Raise UsageError when a variable with a secret isn't set."""
        for target in self.to:
            for key in ("secret_env", "password_env"):
                variable = getattr(target, key, None)
                if variable and variable not in os.environ:
                    raise UsageError(f"{name}: {key} {variable} is not set", "export it")

    def body(self, node: NodeProcess) -> None:
        """Send alarms until every stream of the graph has ended, or until told to stop."""
        from rsenf.run.notify import Notifier
        from rsenf.run.recording import DELIVERY, look_until_ended

        with Notifier(self.queue, self.to, node.graph.site, node.run_id, node.show) as notifier:
            look_until_ended(
                node, self.topics, notifier.take, f"{len(self.to)} targets", delivery=DELIVERY
            )
            notifier.drain(node.stop)
