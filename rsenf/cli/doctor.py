"""Verbs on damaged recordings: examine them, and recover what is whole."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from rsenf.cli.console import print_json, say, tell
from rsenf.errors import EXIT_DONE, EXIT_LOSS, InputError, UsageError
from rsenf.record.examine import Examination, MissingRange, TopicState, examine, made_by

DOCTOR = """\
Examine recordings: their contents, whether they are intact, what was lost, and what to do.

Each file is read completely. Exit code 0: all are intact; 3: some are damaged but usable; 1: at
least one is unusable. A file that is still being recorded needs no end to count as intact. Sequence
numbers absent from a topic are 'lost' where the file is damaged. Elsewhere they are 'missing': they
were never recorded, or were lost before the file was recovered; the file is intact without them."""


SHOWN = 5  # limit of gaps of each topic, and of damaged places
BY_RECOVERY = "rsenf recover {path} --out NEW.mcap"


def add_doctor(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("files", nargs="+", metavar="FILE", help=".mcap recordings")
    parser.add_argument("--json", action="store_true", help="a list with an object for each file")


def run_doctor(args: argparse.Namespace) -> int:
    """Examine recordings."""
    failed = EXIT_DONE
    shown: list[dict[str, Any]] = []
    for path in args.files:
        try:
            found = examine(path)
        except (InputError, UsageError) as exc:
            failed = max(failed, exc.exit_code)
            problem = {"what": exc.message, "do": exc.hint}
            shown.append({"path": path, "verdict": "unusable", "problems": [problem]})
            say(str(exc))
            continue
        shown.append(_recording_json(found))
        if shown[-1]["verdict"] == "unusable":
            failed = max(failed, InputError.exit_code)
        if not args.json:
            print(_recording_words(found))
    if args.json:
        print_json(shown)
    loss = EXIT_LOSS if any(doc["verdict"] == "damaged" for doc in shown) else EXIT_DONE
    return failed or loss


def _verdict(found: Examination) -> str:
    """Return ``whole``, ``damaged`` (but usable) or ``unusable``."""
    if found.whole:
        return "whole"
    return "damaged" if found.messages else "unusable"


def _problems(found: Examination) -> Iterator[tuple[str, str]]:
    """Yield the problems of a recording, each with what to do about it."""
    recover, damages = BY_RECOVERY.format(path=found.path), found.contents.damages
    if not (found.contents.complete or found.in_the_making):
        last = f"its last {found.contents.cut_bytes} bytes are no use"
        yield f"it breaks off: there is no end, and {last}", recover
    for damage in damages[:SHOWN]:
        yield f"bytes {damage.start} to {damage.end}: {damage.why}", recover
    if damages[SHOWN:]:
        yield f"{len(damages) - SHOWN} more damaged places", recover
    if found.short and not damages:
        yield "its end tells of messages that it hasn't got", recover
    for why, count in found.unreadable.items():
        do = f"read them with {made_by(found.contents)}" if "version" in why else recover
        yield f"{count} messages can't be read: {why}", do
    if any(state.duplicates for state in found.topics):
        yield "messages are there more than once", recover


def _recording_json(found: Examination) -> dict[str, Any]:
    about = found.contents.metadata.get("rsenf", {})
    return {
        "path": str(found.path),
        "verdict": _verdict(found),
        "size_bytes": found.size_bytes,
        "complete": found.contents.complete,
        "being_recorded": found.in_the_making,
        "cut_bytes": found.contents.cut_bytes,
        "made_by": made_by(found.contents),
        "created_utc": about.get("created_utc"),
        "run_id": about.get("run_id"),
        "chunks": len(found.contents.index.chunks),
        "messages": found.messages,
        "topics": [_topic_json(state) for state in found.topics],
        "damages": [
            {"start": damage.start, "end": damage.end, "why": damage.why}
            for damage in found.contents.damages
        ],
        "problems": [{"what": what, "do": do} for what, do in _problems(found)],
    }


def _topic_json(state: TopicState) -> dict[str, Any]:
    topic = state.topic
    return {
        "topic": topic.name,
        "schema": topic.schema,
        "schema_version": state.version,
        "messages": topic.messages,
        "first_utc": _utc(topic.first_ns),
        "last_utc": _utc(topic.last_ns),
        "last_seq": state.last_seq,
        "duplicates": state.duplicates,
        "gaps": [
            {
                "run_id": gap.run_id,
                "epoch": gap.epoch,
                "first_seq": gap.first,
                "last_seq": gap.last,
                "cause": "damage" if gap.damaged else "missing",
            }
            for gap in state.gaps
        ],
        "lost_at_end": state.lost_at_end,
    }


def _recording_words(found: Examination) -> str:
    chunks = len(found.contents.index.chunks)
    so_far = " so far, it is being recorded" if found.in_the_making else ""
    lines = [
        f"{found.path}: {_verdict(found)}{so_far}. {found.messages} messages in {chunks} chunks, "
        f"{found.size_bytes / 1e6:.1f} MB, made by {made_by(found.contents)}"
    ]
    width = max((len(state.topic.name) for state in found.topics), default=0)
    lines += [f"  {state.topic.name:{width}}  {_topic_words(state)}" for state in found.topics]
    for what, do in _problems(found):
        lines += [f"  wrong: {what}", f"     do: {do}"]
    return "\n".join(lines)


def _topic_words(state: TopicState) -> str:
    topic = state.topic
    words = []
    if topic.messages:
        seconds = (topic.last_ns - topic.first_ns) / 1e9
        words.append(
            f"{topic.messages} × {topic.schema} from {_utc(topic.first_ns)}, {seconds:.1f} s"
        )
    words += _lost(state)
    words += _named([gap for gap in state.gaps if not gap.damaged], "missing")
    if state.duplicates:
        words.append(f"{state.duplicates} twice")
    return "; ".join(words)


def lost_words(found: Examination) -> dict[str, str]:
    """Return what was recorded and is lost, in words, by topic."""
    return {state.topic.name: "; ".join(words) for state in found.topics if (words := _lost(state))}


def _lost(state: TopicState) -> list[str]:
    words = _named([gap for gap in state.gaps if gap.damaged], "lost")
    after = "all of it" if state.last_seq is None else f"what came after {state.last_seq}"
    if state.lost_at_end:
        words.append(f"{state.lost_at_end} lost: {after}")
    elif state.lost_at_end is None and state.cut:
        words.append(f"{after} is not there")
    return words


def _named(gaps: list[MissingRange], what: str) -> list[str]:
    return [f"{sum(gap.messages for gap in gaps)} {what}: {_numbers(gaps)}"] if gaps else []


def _numbers(gaps: list[MissingRange]) -> str:
    words = [
        f"{gap.first}–{gap.last}" + (f" of epoch {gap.epoch}" if gap.epoch else "")
        for gap in gaps[:SHOWN]
    ]
    return ", ".join(words) + (f", and {len(gaps) - SHOWN} more places" if gaps[SHOWN:] else "")


def _utc(time_ns: int) -> str | None:
    try:
        moment = datetime.fromtimestamp(time_ns // 10**9, UTC).replace(tzinfo=None)
    except (ValueError, OverflowError, OSError):
        return None  # beyond the year 9999
    return f"{moment.isoformat()}.{time_ns % 10**9 // 10**6:03d}Z"


RECOVER = """\
Recover all intact messages of a damaged recording: unfinished, truncated or overwritten.

Damage costs only the chunk that it hit, and the new file lists what was lost. The old one is not
changed; with --in-place it is kept beside the new one, as FILE.damaged. Exit code 0: nothing was
lost; 3: something was, and is listed."""


def add_recover(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("file", metavar="FILE", help=".mcap recording")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="NEW", help="the file to write")
    where.add_argument("--in-place", action="store_true", help="replace FILE, keep FILE.damaged")
    parser.add_argument("--overwrite", action="store_true", help="replace NEW")
    parser.add_argument("--json", action="store_true")


def run_recover(args: argparse.Namespace) -> int:
    """Recover a recording."""
    from rsenf.record.recover import recover, recover_in_place

    if args.in_place:
        found, backup = recover_in_place(args.file)
        out = args.file
        say(f"the damaged file is {backup} now")
    else:
        found, out = recover(args.file, args.out, overwrite=args.overwrite), args.out
    lost = lost_words(found)
    lines = [f"{out}: {found.messages} messages of {len(found.topics)} topics saved"]
    lines += [f"  {topic}: {words}" for topic, words in lost.items()]
    document = {"out": out, "messages": found.messages, "lost": lost}
    tell(args, document | {"found": _recording_json(found)}, "\n".join(lines))
    return EXIT_LOSS if lost else EXIT_DONE
