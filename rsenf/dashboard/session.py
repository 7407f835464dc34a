"""Incremental updates for one browser: sends only what has changed since the last one."""

from __future__ import annotations

import json
from collections import deque
from typing import Any

from rsenf.dashboard.enf_series import KEPT, RECENT
from rsenf.dashboard.site import Site

VERSION = 1
UNSEEN = (0, 0)
SILENCE_NS = 5_000_000_000  # after which an empty update is sent as a keep-alive


class Session:
    """One connection of a browser: the first update is complete, later ones hold the changes.

    Parameters
    ----------
    site : Site
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._sent: dict[str, str] = {}
        self._watched, self._series = "", RECENT
        self._seen = {"strip": UNSEEN, "spectrogram": UNSEEN}
        # Filled in one thread, read in another.
        self._asked: deque[str] = deque(maxlen=1)
        self._sent_ns = 0

    def ask(self, text: str) -> None:
        """Select the feed to be shown in full: ``{"feed": NAME, "series": "recent"}``."""
        self._asked.append(text)

    def _turn_to(self, text: str) -> None:
        """Switch to the feed that is asked for; an invalid request is ignored."""
        try:
            asked = json.loads(text)
            name, series = str(asked["feed"]), str(asked.get("series", RECENT))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return
        if name != self._watched:
            self._seen = dict.fromkeys(self._seen, UNSEEN)
        self._watched, self._series = name, series if series in KEPT else RECENT
        self._sent.pop("chart", None)

    def news(self) -> str:
        """Return what has changed since the last call, as JSON.

        Empty if nothing has, except for a keep-alive after SILENCE_NS.
        """
        site = self._site
        while self._asked:
            self._turn_to(self._asked.pop())
        with site.lock:
            fresh = self._changed("card/", {n: site.card(n) for n in site.feed_names})
            parts = {
                "cards": list(fresh.values()),
                **self._changed("", self._boards()),
                **self._detail(),
            }
        parts = {name: part for name, part in parts.items() if part != []}
        now_ns = site.clock_ns()
        if not parts and 0 <= now_ns - self._sent_ns < SILENCE_NS:
            return ""
        self._sent_ns = now_ns
        update = {"version": VERSION, "now_ms": now_ns // 1_000_000, **parts}
        return json.dumps(update, allow_nan=False, separators=(",", ":"))

    def _boards(self) -> dict[str, Any]:
        site = self._site
        return {
            "nodes": {"list": site.nodes.plain(site.clock_ns())},
            "alarms": {"list": site.alarms.plain()},
            "site": {
                "feeds": site.feed_names,
                "left_out": site.feeds_left_out > 0,
                "has_archive": site.wiring.archive is not None,
            },
        }

    def _detail(self) -> dict[str, Any]:
        """Return the changes of the feed that is shown in full."""
        feed = self._site.feed(self._watched)
        if feed is None:
            return {}
        found = self._changed("", {"chart": {"feed": feed.name, **feed.chart(self._series)}})
        pictures = {
            "strip": (feed.strip.columns.seen, feed.strip_plain),
            "spectrogram": (feed.spectrogram.columns.seen, feed.spectrogram_plain),
        }
        for name, (there, plain) in pictures.items():
            if there != self._seen[name]:
                found[name] = {"feed": feed.name, **plain(self._seen[name])}
                self._seen[name] = there
        return found

    def _changed(self, prefix: str, parts: dict[str, Any]) -> dict[str, Any]:
        """Return the parts that differ from those sent last."""
        fresh = {}
        for name, part in parts.items():
            text = json.dumps(part, allow_nan=False)
            if self._sent.get(prefix + name) != text:
                self._sent[prefix + name] = text
                fresh[name] = part
        return fresh
