"""What an archive has of a camera, as JSON and in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsenf.record.archive.alarms import AlarmSpan, alarms_of
from rsenf.record.archive.holdings import Gap, Holding, TopicHolding
from rsenf.record.archive.index import Entry
from rsenf.record.archive.summary import TRUNCATED
from rsenf.record.held import is_held
from rsenf.timebase import seconds, utc_text

WRITING = "writing"
MOST_GAPS = 10


def document(holding: Holding, root: Path) -> dict[str, Any]:
    """Return all of it, as JSON."""
    return {
        "site": holding.camera.site,
        "camera": holding.camera.name,
        **_span(*holding.asked),
        "topics": [_topic(name, topic) for name, topic in holding.topics.items()],
        "alarms": [
            {**_span(span.from_ns, span.to_ns), "why": span.why} for span in _alarms(holding, root)
        ],
        "files": [_file(entry, root) for entry in holding.files],
    }


def _span(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        "from_utc": utc_text(first_ns),
        "to_utc": utc_text(last_ns),
        "from_ns": str(first_ns),
        "to_ns": str(last_ns),
    }


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


def words(holding: Holding, root: Path) -> str:
    """Return what a person wants to know first."""
    asked = holding.asked
    lines = [f"{holding.camera}  {utc_text(asked.first_ns)} to {utc_text(asked.last_ns)}"]
    for name, topic in holding.topics.items():
        lines += _topic_words(name.split("/", 3)[-1], topic, asked.last_ns - asked.first_ns)
    for span in _alarms(holding, root):
        lines.append(f"  alarm      {_times(span.from_ns, span.to_ns)}  {span.why}")
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


def _gap_words(gap: Gap) -> str:
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
    return "  file       " + "  ".join(
        filter(None, (when, name, size, ", ".join(filter(None, lost))))
    )


def _times(first_ns: int, last_ns: int) -> str:
    first, last = str(utc_text(first_ns)), str(utc_text(last_ns))
    return f"{first[11:]} to {last[11:] if last[:10] == first[:10] else last}"
