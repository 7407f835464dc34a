"""List the contents of an archive, and its gaps.

    rsenf archive recordings
    rsenf archive recordings --camera cam3 --from 10:00 --to 11:00
    rsenf archive recordings --camera cam3 --from 2026-01-15T22:00 --to 2026-01-16T02:00 --json

Times are UTC unless they state a zone. One without a date refers to --day, or to the last day with
data. --from 23:50 --to 00:10 passes midnight; --day alone is the whole day.

The archive's index.json caches a summary of each file. A file whose end is intact is trusted;
damage before its end is found by --check, which reads each file once, or by 'rsenf doctor'.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from rsenf.cli.console import note, print_json
from rsenf.errors import UsageError
from rsenf.record.archive.alarms import AlarmSpan, acknowledged, alarms_of
from rsenf.record.archive.holdings import Holding, HoldingGap, TopicHolding, extent_of, holding
from rsenf.record.archive.index import TRUNCATED, Entry, read_archive
from rsenf.record.archive.layout import Camera, day_of
from rsenf.record.index import Stretch
from rsenf.record.output import is_held
from rsenf.reference.open import utc_ns
from rsenf.timebase import seconds, utc_text

WRITING = "writing"
MOST_GAPS = 10


def add_archive(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("archive", type=Path, metavar="DIR")
    parser.add_argument("--site", metavar="NAME", help="(all)")
    parser.add_argument("--camera", metavar="NAME", help="(all)")
    parser.add_argument("--from", dest="from_", metavar="TIME", help="(the first message)")
    parser.add_argument("--to", metavar="TIME", help="(the last message)")
    parser.add_argument("--day", metavar="DATE", help="of times without a date")
    parser.add_argument("--check", action="store_true", help="read all of each file, once")
    parser.add_argument("--json", action="store_true")


def run_archive(args: argparse.Namespace) -> int:
    """Print the contents of an archive."""
    entries = read_archive(args.archive, check=args.check)
    cameras = _cameras(args, entries)
    starts = {c: [e.file.start_ns for e in entries if e.file.camera == c] for c in cameras}
    # By file names where files can't be read.
    extents = {c: extent_of(entries, c) or Stretch(s[0], s[-1]) for c, s in starts.items()}
    limits = _limits(args, max((each.last_ns for each in extents.values()), default=0))
    asked = {camera: _asked(limits, extents[camera]) for camera in cameras}
    found = [holding(entries, camera, when) for camera, when in asked.items()]
    seen = acknowledged(args.archive)
    if args.json:
        documents = [document(each, args.archive, seen) for each in found]
        print_json({"archive": str(args.archive), "cameras": documents})
    elif found:
        print("\n\n".join(words(each, args.archive, seen) for each in found))
    else:
        note(f"{args.archive} holds no recordings; rsenf record --archive makes some")
    return 0


def _cameras(args: argparse.Namespace, entries: list[Entry]) -> list[Camera]:
    every = sorted({entry.file.camera for entry in entries})
    chosen = [c for c in every if args.site in (None, c.site) and args.camera in (None, c.name)]
    if not chosen and (args.site or args.camera):
        wanted = "/".join(filter(None, (args.site, args.camera)))
        there = ", ".join(map(str, every)) or "none"
        raise UsageError(f"{args.archive}: nothing of {wanted!r}", f"its cameras: {there}")
    return chosen


def _limits(args: argparse.Namespace, latest_ns: int) -> tuple[int | None, int | None]:
    """Return start and end as far as given; the default date is that of the latest message."""
    day, day_ns = args.day or day_of(latest_ns), 86_400 * 10**9
    first_ns = last_ns = None
    if args.day:
        if not re.fullmatch(r"\d{4}-\d\d-\d\d", args.day):
            raise UsageError(f"--day {args.day!r} is not a date", "e.g. 2026-01-15")
        first_ns = utc_ns(args.day, "--day")
        last_ns = first_ns + day_ns
    if args.from_:
        first_ns = utc_ns(_dated(args.from_, day), "--from")
    if args.to:
        last_ns = utc_ns(_dated(args.to, day), "--to")
    if first_ns is None or last_ns is None or first_ns < last_ns:
        return first_ns, last_ns
    if first_ns == last_ns or not (_lacks_date(args.from_) and _lacks_date(args.to)):
        raise UsageError("nothing lies between --from and --to", "see 'rsenf archive --help'")
    if args.day or first_ns <= latest_ns:
        return first_ns, last_ns + day_ns
    return first_ns - day_ns, last_ns


def _asked(limits: tuple[int | None, int | None], all_of_it: Stretch) -> Stretch:
    """Return the requested time span of a camera; all its data where no limit is given."""
    first_ns, last_ns = limits
    if first_ns is None:
        first_ns = all_of_it.first_ns if last_ns is None else min(all_of_it.first_ns, last_ns)
    if last_ns is None:
        last_ns = max(all_of_it.last_ns, first_ns)
    return Stretch(first_ns, last_ns)


def _lacks_date(text: str | None) -> bool:
    return text is not None and re.match(r"\d\d:\d\d", text) is not None


def _dated(text: str, day: str) -> str:
    return f"{day}T{text}" if _lacks_date(text) else text


def document(holding: Holding, root: Path, seen: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the JSON document of a camera.

    Parameters
    ----------
    holding : Holding
        What the archive has of it in the requested time.
    root : Path
        Folder of the archive.
    seen : list of dict
        The archive's acknowledged alarms, of all cameras.
    """
    return {
        "site": holding.camera.site,
        "camera": holding.camera.name,
        **_span(*holding.asked),
        "topics": [_topic(name, topic) for name, topic in holding.topics.items()],
        "alarms": [
            {**_span(span.from_ns, span.to_ns), "why": span.why} for span in _alarms(holding, root)
        ],
        "acknowledged": [
            {"kind": alarm["kind"], **_span(_ns(alarm["start_ms"]), _ns(alarm["end_ms"]))}
            | {"by": alarm["ack"]["by"], "note": alarm["ack"]["note"]}
            for alarm in _acknowledged(holding, seen)
        ],
        "files": [_file(entry, root) for entry in holding.files],
    }


def _span(first_ns: int, last_ns: int) -> dict[str, Any]:
    utc = {"from_utc": utc_text(first_ns), "to_utc": utc_text(last_ns)}
    return utc | {"from_ns": str(first_ns), "to_ns": str(last_ns)}


def _topic(name: str, topic: TopicHolding) -> dict[str, Any]:
    gaps = None
    if topic.gaps is not None:
        gaps = [{**_span(g.first_ns, g.last_ns), "missing": g.missing} for g in topic.gaps]
    return {
        "topic": name,
        "messages": topic.messages,
        "missed": topic.missed,
        "covered_s": seconds(topic.covered_ns),
        "stretches": [_span(*stretch) for stretch in topic.stretches],
        "gaps": gaps,
        "shortest_gap_s": seconds(max(topic.pause_ns, topic.coarse_ns)),
    }


def _file(entry: Entry, root: Path) -> dict[str, Any]:
    summary, extent = entry.summary, entry.summary.extent
    return {
        "file": entry.file.path.relative_to(root).as_posix(),
        "state": _state(entry),
        "of_alarm": entry.file.of_alarm,
        "size_bytes": summary.size_bytes,
        "cut_bytes": summary.cut_bytes,
        "damaged": summary.damaged,
        "checked": summary.checked,
        "recovered": summary.recovered,
        **({} if extent is None else _span(*extent)),
        "topics": {
            name: {"messages": topic.messages, "missed": topic.missed}
            for name, topic in summary.topics.items()
        },
    }


def _state(entry: Entry) -> str:
    try:
        writing = entry.summary.state == TRUNCATED and is_held(entry.file.path)
    except OSError:  # gone, or not ours to open
        writing = False
    return WRITING if writing else entry.summary.state


def _alarms(holding: Holding, root: Path) -> list[AlarmSpan]:
    return [span for span in alarms_of(root, holding.camera) if span.covers(*holding.asked)]


def _acknowledged(holding: Holding, seen: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return those of a camera and the requested time."""
    asked = holding.asked
    return [
        alarm
        for alarm in seen
        if alarm["feed"] == str(holding.camera)
        and _ns(alarm["start_ms"]) <= asked.last_ns
        and _ns(alarm["end_ms"]) >= asked.first_ns
    ]


def _ns(time_ms: float) -> int:
    return round(time_ms * 1e6)


def words(holding: Holding, root: Path, seen: list[dict[str, Any]]) -> str:
    """Return the summary of a camera as text; parameters as for :func:`document`."""
    asked = holding.asked
    lines = [f"{holding.camera}  {utc_text(asked.first_ns)} to {utc_text(asked.last_ns)}"]
    for name, topic in holding.topics.items():
        lines += _topic_words(name.split("/", 3)[-1], topic, asked.last_ns - asked.first_ns)
    for span in _alarms(holding, root):
        lines.append(f"  kept       {_times(span.from_ns, span.to_ns)}  around {span.why}")
    for alarm in _acknowledged(holding, seen):
        when = _times(_ns(alarm["start_ms"]), _ns(alarm["end_ms"]))
        said = ": ".join(filter(None, (alarm["ack"]["by"], alarm["ack"]["note"])))
        lines.append(f"  seen       {when}  {alarm['kind']}, by {said}")
    lines += [_file_words(entry, root) for entry in holding.files]
    if not holding.files:
        lines.append("  nothing")
    return "\n".join(lines)


def _topic_words(name: str, topic: TopicHolding, asked_ns: int) -> list[str]:
    missed = f", {topic.missed} missed" if topic.missed else ""
    if topic.gaps is None:
        return [f"  {name:10} {topic.messages} messages{missed}"]
    share = topic.covered_ns / asked_ns if asked_ns else 1.0
    gaps = f"{len(topic.gaps)} gap{'s' * (len(topic.gaps) != 1)}" if topic.gaps else "no gaps"
    if topic.coarse_ns:
        gaps += f" (those of up to {seconds(topic.coarse_ns):.0f} s aren't told)"
    head = f"  {name:10} {100 * share:.1f} % of the time, {gaps}{missed}"
    shown = [f"    gap      {_gap_words(gap)}" for gap in topic.gaps[:MOST_GAPS]]
    rest = len(topic.gaps) - len(shown)
    return [head, *shown, *([f"    and {rest} more; --json lists them all"] if rest else [])]


def _gap_words(gap: HoldingGap) -> str:
    missing = "" if gap.missing is None else f", {gap.missing} messages missing"
    if gap.missing == 0:
        missing = ", nothing was sent"
    length_s = seconds(gap.last_ns - gap.first_ns)
    return f"{_times(gap.first_ns, gap.last_ns)}  {length_s:.1f} s{missing}"


def _file_words(entry: Entry, root: Path) -> str:
    summary, extent, state = entry.summary, entry.summary.extent, _state(entry)
    when = "no messages" if extent is None else _times(*extent)
    lost = [
        "" if state == "complete" else state,
        f"{summary.cut_bytes} bytes cut off" if summary.cut_bytes and state != WRITING else "",
        f"{summary.damaged} damaged places" if summary.damaged else "",
        "what was left of a damaged one" if summary.recovered else "",
    ]
    name = entry.file.path.relative_to(root).as_posix()
    size = f"{summary.size_bytes / 1e6:.1f} MB"
    words = filter(None, (when, name, size, ", ".join(filter(None, lost))))
    return f"  file       {'  '.join(words)}"


def _times(first_ns: int, last_ns: int) -> str:
    first, last = str(utc_text(first_ns)), str(utc_text(last_ns))
    return f"{first[11:]} to {last[11:] if last[:10] == first[:10] else last}"
