"""Names in a graph file: of nodes, cameras and topics, and their renaming on replay."""

from __future__ import annotations

from typing import Annotated

from pydantic import (
    AfterValidator,
    Field,
)

from rsenf.bus.keys import (
    NAME_PATTERN,
    NAME_RULE,
    REFERENCE,
    TOPICS,
    is_name,
    topic_of,
)


def named(text: str) -> str:
    """Return a name if it is valid as a part of a key; otherwise raise ValueError."""
    if not is_name(text):
        raise ValueError(f"no name: {NAME_RULE}")
    return text


def not_reserved(text: str) -> str:
    """Return a camera's name if it isn't reserved; otherwise raise ValueError."""
    if text == REFERENCE:
        raise ValueError(f"{REFERENCE!r} is taken: the references of the grids go by it")
    return text


def _topic(text: str) -> str:
    first, _, last = text.partition("/")
    camera_topics = [t for t in TOPICS if t not in (REFERENCE, "health")]
    if not (is_name(first) and is_name(last) and (first == REFERENCE or last in camera_topics)):
        known = ", ".join(camera_topics)
        raise ValueError(f"no topic: CAMERA/TOPIC with one of {known}; or {REFERENCE}/GRID")
    return text


def ensure_renamed(old: str, new: str, topics: tuple[str, ...] | None) -> None:
    """Check a renaming of a replay node, of one topic or of a whole camera.

    Parameters
    ----------
    old, new : str
        Both ``<camera>/<topic>`` or both ``<camera>``.
    topics : tuple of str or None
        Topics that the node plays; None for all.

    Raises
    ------
    ValueError
        When a name is invalid, isn't played, or belongs to another type of message.
    """
    is_topic = "/" in old
    for text in (old, new):
        try:
            _topic(text) if is_topic else not_reserved(named(text))
        except ValueError as exc:
            raise ValueError(f"{text!r} is {exc}") from exc
    known = {t if is_topic else t.split("/")[0] for t in topics or ()}
    if topics and old not in known:
        raise ValueError(f"{old!r} isn't among the topics, so it can't be renamed")
    if is_topic and topic_of(f"//{old}") != topic_of(f"//{new}"):
        raise ValueError(f"{old!r} can't be played as {new!r}: another message")


# One chunk of a key on the bus.
Name = Annotated[
    str,
    AfterValidator(named),
    Field(max_length=64, json_schema_extra={"pattern": f"^{NAME_PATTERN}$"}),
]
Camera = Annotated[Name, AfterValidator(not_reserved)]
# The part of a key after the site.
Topic = Annotated[str, AfterValidator(_topic)]
