"""Choice of the topics of a recording to replay, and their keys on the bus."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any

from rsenf.bus.keys import (
    NAME_RULE,
    REFERENCE,
    ROOT,
    TOPICS,
    is_name,
    matches,
    renamed,
    source_of,
    topic_of,
)
from rsenf.errors import UsageError
from rsenf.messages import ReferenceBlock
from rsenf.record.reader import Recording

VIDEO, FRAMES, HEALTH = "video", "frames", "health"


def chosen(
    recording: Recording,
    wanted: Collection[str] = (),
    rename: Mapping[str, str] | None = None,
    site: str = "",
) -> dict[str, str]:
    """Choose topics of a recording.

    Parameters
    ----------
    recording : Recording
    wanted : collection of str
        Key expressions below the site, such as ``cam1/rows``, ``*/track`` or ``reference/ce``;
        ``frames`` stands for the decoded video. If empty: all topics, without decoding video.
    rename : mapping, optional
        New names by old, of cameras (``door``) or topics (``door/rows``, ``reference/ce``).
    site : str
        Site to replay to; the recorded one if empty.

    Returns
    -------
    dict of str to str
        Key on the bus by recorded key.

    Raises
    ------
    UsageError
        When a wanted topic doesn't exist, or a new name is not valid.
    """
    there = _playable(recording)
    found = dict.fromkeys(k for k in there if topic_of(k) != FRAMES) if not wanted else {}
    for expr in wanted:
        hits = [key for key in there if matches(expr, _below(key))]
        if not hits:
            raise UsageError(f"{recording.path}: nothing to play as {expr!r}", _hint(there, expr))
        found.update(dict.fromkeys(hits))
    if not found:
        raise UsageError(f"{recording.path}: holds nothing that could be played")
    names = {key: _name(key, rename or {}, site) for key in found}
    _check(recording, names, rename or {})
    return names


def as_named(message: Any, key: str) -> Any:
    """Return a message with the source, and for a reference the grid, of its key."""
    grid = key.split("/")[3] if topic_of(key) == REFERENCE else ""
    source = f"{REFERENCE}/{grid}" if grid else source_of(key)
    message = dataclasses.replace(
        message, header=dataclasses.replace(message.header, source=source)
    )
    return (
        dataclasses.replace(message, grid=grid) if isinstance(message, ReferenceBlock) else message
    )


def _playable(recording: Recording) -> list[str]:
    """Return the keys that can be replayed: not health; frames only where there is a video."""
    keys = [k for k, t in recording.topics.items() if t.is_ours and k.startswith(f"{ROOT}/")]
    signals = [k for k in keys if topic_of(k) in TOPICS and topic_of(k) not in (HEALTH, FRAMES)]
    return [*signals, *(with_topic(k, FRAMES) for k in signals if topic_of(k) == VIDEO)]


def with_topic(key: str, topic: str) -> str:
    """Return the key of another topic of the same camera."""
    return f"{key.rpartition('/')[0]}/{topic}"


def _below(key: str) -> str:
    return key.split("/", 2)[2]


def _name(key: str, rename: Mapping[str, str], site: str) -> str:
    return f"{ROOT}/{site or key.split('/')[1]}/{renamed(_below(key), rename)}"


def _hint(there: list[str], expr: str) -> str:
    if expr.endswith(f"/{FRAMES}"):
        return "frames are decoded from the recorded video, which isn't there; take the rows"
    return f"there is: {', '.join(map(_below, there)) or 'nothing'}"


def _check(recording: Recording, names: Mapping[str, str], rename: Mapping[str, str]) -> None:
    for old in rename:
        if not any(_below(key) == old or _below(key).split("/")[0] == old for key in names):
            raise UsageError(f"{recording.path}: {old!r} isn't played, so it can't be renamed")
    for key, name in names.items():
        parts = name.split("/")
        if len(parts) != len(key.split("/")) or not all(map(is_name, parts)):
            raise UsageError(f"{name!r} is no name for a topic", NAME_RULE)
        if TOPICS.get(topic_of(name)) is not TOPICS[topic_of(key)]:
            raise UsageError(
                f"{_below(key)!r} can't be played as {_below(name)!r}: another message"
            )
        others = [other for other, also in names.items() if also == name]
        if len(others) > 1:
            raise UsageError(f"{' and '.join(others)} would both be {name}", "rename one of them")
