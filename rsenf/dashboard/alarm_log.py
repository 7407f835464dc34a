"""The log of alarms by day: when each began and ended, and who has acknowledged it.

It is a file of JSON Lines in the archive's folder, one line for each change of an alarm; the last
line of an alarm holds. Without an archive it is kept in memory, up to a number of alarms.
"""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

FILE = "alarms.jsonl"
VERSION = 1
KEPT_LINES = 200  # in memory
MOST_OF_A_DAY = 500
LONGEST_NAME, LONGEST_NOTE = 64, 500


class AlarmLog:
    """Alarms and acknowledgements, kept.

    Parameters
    ----------
    folder : Path or None
        Of the archive.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = folder / FILE if folder else None
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        acknowledged = deque(((line["id"], line["ack"]) for line in self._read() if line["ack"]),
                             KEPT_LINES)  # fmt: skip
        self._acknowledged = dict(acknowledged)

    def acknowledgement(self, identity: str) -> dict[str, Any] | None:
        """Return by whom an alarm was acknowledged, with the note and the time; None if it isn't.

        Parameters
        ----------
        identity : str
            Of the alarm, the same after a restart.
        """
        return self._acknowledged.get(identity)

    def note(self, identity: str, alarm: dict[str, Any]) -> None:
        """Note what has become of an alarm.

        Parameters
        ----------
        identity : str
        alarm : dict
            As the page has it.

        Raises
        ------
        OSError
            When the file can't be written to.
        """
        line = json.dumps({"version": VERSION, "id": identity, **alarm}, allow_nan=False)
        if self._path is None:
            self._lines.append(line)
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("ab", buffering=0) as file:  # each line in one write
            file.write(line.encode() + b"\n")

    def day(self, day: str) -> dict[str, Any]:
        """Return the days that have alarms, with their numbers, and the alarms of one.

        Parameters
        ----------
        day : str
            As ``2026-01-15``, UTC; the last one if there is no such day.

        Returns
        -------
        dict
            ``days``: day and number of alarms, newest first; ``day``; ``alarms``, newest first.
        """
        latest = {line["id"]: line for line in self._read()}
        count = Counter(_day(line) for line in latest.values())
        days = sorted(count, reverse=True)
        day = day if day in count else next(iter(days), "")
        alarms = sorted(
            (line for line in latest.values() if _day(line) == day),
            key=lambda line: float(line["start_ms"]),
            reverse=True,
        )
        return {
            "days": [[name, count[name]] for name in days],
            "day": day,
            "alarms": alarms[:MOST_OF_A_DAY],
        }

    def _read(self) -> Iterator[dict[str, Any]]:
        """Yield the lines; one that was cut off by a crash is left out."""
        for text in self._texts():
            try:
                line = json.loads(text)
                _day(line)
                _ = line["id"], line["ack"]
            except (ValueError, KeyError, TypeError, OverflowError):
                continue
            yield line

    def _texts(self) -> Iterator[str]:
        if self._path is None:
            yield from tuple(self._lines)
        elif self._path.is_file():
            with self._path.open(encoding="utf-8", errors="replace") as file:
                yield from file


def _day(line: dict[str, Any]) -> str:
    return datetime.fromtimestamp(line["start_ms"] / 1000, UTC).strftime("%Y-%m-%d")
