"""Alarms to people: a queue on disk for each target, and the ways to send them.

Of each alarm of a camera one notification is queued when it begins, and one when it is over, in the
transaction that notes that its message was taken: neither is lost or queued twice when the process
dies. Each target has a thread that sends the oldest first, and tries again with growing pauses. It
is sent twice only if the process dies after the target took it and before that is noted; both have
the same ``id`` then.
"""

from __future__ import annotations

import base64
import fnmatch
import hashlib
import hmac
import json
import logging
import math
import os
import re
import sqlite3
import subprocess
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from datetime import time as TimeOfDay
from pathlib import Path
from typing import Any

from rsenf.bus.inbox import Received
from rsenf.bus.keys import source_of
from rsenf.config import redact
from rsenf.errors import RsenfError
from rsenf.messages import Alarm
from rsenf.run.process import wait_until

VERSION = 1
SEVERITIES = ("info", "warning", "alarm")
PAUSES_S = (1.0, 2.0, 5.0, 15.0, 60.0, 300.0)  # after failures; the last one repeats
TIMEOUT_S = 20.0
DRAIN_S = 10.0  # at the end; what isn't sent stays for the next run
LAST_S = 0.5  # when told to stop, and again for a message on its way: then it would be killed
KEPT = 10_000  # messages remembered, so that none is taken twice
_TABLES = """
PRAGMA journal_mode = WAL;
CREATE TABLE IF NOT EXISTS taken (id TEXT PRIMARY KEY);
CREATE TABLE IF NOT EXISTS active (camera TEXT, kind TEXT, run TEXT, targets TEXT, body TEXT,
    PRIMARY KEY (camera, kind));
CREATE TABLE IF NOT EXISTS waiting (
    n INTEGER PRIMARY KEY AUTOINCREMENT, target TEXT, body TEXT);
"""


class Notifier:
    """Queues and sends notifications; for a ``with`` block.

    Parameters
    ----------
    queue : str
        SQLite file of what is active and what waits.
    targets : sequence of rsenf_nodes.notify.Target
        Who is told. A target whose settings change is another one; what waits for it is dropped.
    site, run_id : str
        Of the graph. Alarms of an earlier run that never ended are over.
    show : callable
        Called with a line about the queue.

    Raises
    ------
    RsenfError
        When the queue can't be opened.
    """

    def __init__(
        self,
        queue: str,
        targets: Sequence[Any],
        site: str,
        run_id: str,
        show: Callable[[str], None],
    ) -> None:
        self._site, self._run, self._show = site, run_id.partition(".")[0], show
        self._targets = {_name_of(target): target for target in targets}
        # Of the queue; notified when something waits, or to stop.
        self._lock = threading.Condition()
        self._stop = threading.Event()
        self._sent, self._trouble = 0, dict[str, str]()
        try:
            Path(queue).parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(queue, check_same_thread=False)
            self._db.executescript(_TABLES)
        except (OSError, sqlite3.Error) as exc:
            raise RsenfError(f"can't open the queue {queue}: {exc}", "check the folder") from exc
        self._threads = [
            threading.Thread(target=self._work, args=item, name=f"notify {item[0]}", daemon=True)
            for item in self._targets.items()
        ]

    def __enter__(self) -> Notifier:
        with self._lock, self._db:
            marks = ",".join("?" * len(self._targets))
            self._db.execute(f"DELETE FROM waiting WHERE target NOT IN ({marks})", [*self._targets])
            rows = self._db.execute("SELECT camera, kind, run, body FROM active").fetchall()
            for camera, kind, run, body in rows:
                if run != self._run:
                    said = json.loads(body)
                    self._end(camera, kind, {**said, "text": "rsenf was started again"})
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        with self._lock:
            self._lock.notify_all()
        end_s = time.monotonic() + LAST_S
        for thread in self._threads:
            thread.join(max(end_s - time.monotonic(), 0.0))
        if not any(thread.is_alive() for thread in self._threads):
            self._db.close()

    def take(self, received: Received) -> None:
        """Queue what a message begins or ends."""
        alarm = received.message
        if not isinstance(alarm, Alarm) or alarm.header.is_end:
            return
        header, camera = alarm.header, source_of(received.key)
        number = f"{camera} {header.run_id} {header.epoch} {header.seq} {alarm.kind}"
        with self._lock, self._db:
            if not self._db.execute("INSERT OR IGNORE INTO taken VALUES (?)", [number]).rowcount:
                return
            last = "(SELECT max(rowid) FROM taken)"
            self._db.execute(f"DELETE FROM taken WHERE rowid <= {last} - {KEPT}")
            body = self._body(camera, alarm, number)
            if alarm.active:
                self._begin(camera, alarm.kind, body)
            else:
                self._end(camera, alarm.kind, body)
            self._lock.notify_all()

    def _body(self, camera: str, alarm: Alarm, number: str) -> dict[str, Any]:
        values = {"value": alarm.value, "limit": alarm.limit}
        return {
            "version": VERSION,
            "id": hashlib.sha256(number.encode()).hexdigest()[:16],
            "time": datetime.now(UTC).isoformat(timespec="seconds"),
            "site": self._site,
            "camera": camera.partition("/")[2],
            "kind": alarm.kind,
            "severity": alarm.severity,
            "active": alarm.active,
            "text": alarm.text,
            **{name: value for name, value in values.items() if math.isfinite(value)},
            "unit": alarm.unit,
        }

    def _begin(self, camera: str, kind: str, body: dict[str, Any]) -> None:
        query = "SELECT 1 FROM active WHERE camera = ? AND kind = ?"
        if self._db.execute(query, [camera, kind]).fetchone():
            return  # a restarted node raises it again
        now = datetime.now().time()  # people sleep by local time
        targets = [name for name, target in self._targets.items() if _wants(target, body, now)]
        entry = [camera, kind, self._run, json.dumps(targets), json.dumps(body)]
        self._db.execute("INSERT INTO active VALUES (?, ?, ?, ?, ?)", entry)
        self._queue(targets, body)

    def _end(self, camera: str, kind: str, body: dict[str, Any]) -> None:
        """Tell those who were told of the beginning."""
        where = "FROM active WHERE camera = ? AND kind = ?"
        rows = self._db.execute(f"SELECT targets, body {where}", [camera, kind]).fetchall()
        self._db.execute(f"DELETE {where}", [camera, kind])
        for targets, begun in rows:
            over = {"active": False, "began": json.loads(begun)["time"]}
            if body["active"]:  # the end never came
                over |= {"id": f"{body['id']}-over"}
            self._queue(json.loads(targets), {**body, **over})

    def _queue(self, targets: Iterable[str], body: dict[str, Any]) -> None:
        text = json.dumps(body)
        rows = [(name, text) for name in targets if name in self._targets]
        self._db.executemany("INSERT INTO waiting (target, body) VALUES (?, ?)", rows)

    def _work(self, name: str, target: Any) -> None:
        failures = 0
        while not self._stop.is_set():
            try:
                is_sent = self._send_oldest(name, target)
            except Exception as exc:  # noqa: BLE001 - whatever it is, it is tried again
                self._trouble[name] = redact(f"{name}: {exc or type(exc).__name__}")
                self._tell()
                self._stop.wait(PAUSES_S[min(failures, len(PAUSES_S) - 1)])
                failures += 1
                continue
            failures = 0
            if is_sent:
                self._trouble.pop(name, None)
                self._tell()
            else:
                with self._lock:
                    self._lock.wait(1.0)

    def _send_oldest(self, name: str, target: Any) -> bool:
        """Send what has waited longest for a target; return whether anything waited."""
        query = "SELECT n, body FROM waiting WHERE target = ? ORDER BY n LIMIT 1"
        with self._lock:
            row = self._db.execute(query, [name]).fetchone()
        if row is None:
            return False
        SENDERS[target.via](target, json.loads(row[1]))
        with self._lock, self._db:
            self._db.execute("DELETE FROM waiting WHERE n = ?", [row[0]])
            self._sent += 1
        return True

    @property
    def waiting(self) -> int:
        """Number of notifications that aren't sent yet."""
        with self._lock:
            return int(self._db.execute("SELECT count(*) FROM waiting").fetchone()[0])

    def _tell(self) -> None:
        counts = f"{self._sent} sent, {self.waiting} waiting"
        self._show("; ".join([counts, *self._trouble.copy().values()]))

    def drain(self, stop: threading.Event) -> None:
        """Wait briefly until everything is sent; the rest stays for the next run."""
        wait_until(lambda: not self.waiting or stop.is_set(), DRAIN_S)
        wait_until(lambda: not self.waiting, LAST_S)


def _name_of(target: Any) -> str:
    """Name a target by its settings, without secrets."""
    text = target.model_dump_json().encode()
    return f"{target.via}-{hashlib.sha256(text).hexdigest()[:8]}"


def _wants(target: Any, body: dict[str, Any], now: TimeOfDay) -> bool:
    begin, end = target.quiet_from, target.quiet_until
    if begin is not None and end is not None:
        is_quiet = begin <= now < end if begin <= end else now >= begin or now < end
        if is_quiet:
            return False
    return (
        any(fnmatch.fnmatchcase(body["camera"], pattern) for pattern in target.cameras)
        and any(fnmatch.fnmatchcase(body["kind"], pattern) for pattern in target.kinds)
        and _rank(body["severity"]) >= _rank(target.severity)
    )


def _rank(severity: str) -> int:
    """Return the place of a severity; an unknown one, of another program, is the highest."""
    return SEVERITIES.index(severity) if severity in SEVERITIES else len(SEVERITIES)


def line_of(body: dict[str, Any]) -> str:
    """Return a notification as a line for a person."""
    what = f"{body['severity']}: {body['kind']}" if body["active"] else f"over: {body['kind']}"
    return f"{what} at {body['site']}/{body['camera']}: {body['text']}"


def _by_program(target: Any, body: dict[str, Any]) -> None:
    done = subprocess.run(
        target.command, input=json.dumps(body), text=True, timeout=target.limit_s,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True, check=False,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [""])[-1]
        raise RsenfError(f"{target.command[0]} ended with {done.returncode}: {last}"[:200])


def _by_webhook(target: Any, body: dict[str, Any]) -> None:
    import urllib.request
    from urllib.parse import unquote, urlsplit

    data = json.dumps(body).encode()
    headers = {"Content-Type": "application/json", "Idempotency-Key": body["id"]}
    if target.secret_env:
        key = os.environ[target.secret_env].encode()
        digest = hmac.new(key, data, hashlib.sha256).hexdigest()
        headers["X-Rsenf-Signature"] = f"sha256={digest}"
    parts = urlsplit(target.url)
    if parts.username is not None:
        login = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
        headers["Authorization"] = f"Basic {base64.b64encode(login.encode()).decode()}"
    url = parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()
    request = urllib.request.Request(url, data, headers)
    with urllib.request.urlopen(request, timeout=TIMEOUT_S):
        pass  # a status of 400 or more raises


def _by_mqtt(target: Any, body: dict[str, Any]) -> None:
    import ssl

    from paho.mqtt import publish

    # Nothing in a kind may be a level or a wild card of a topic.
    place = f"{body['site']}/{body['camera']}/{re.sub(r'[^A-Za-z0-9_-]', '_', body['kind'])}"
    state = f"{target.topic}/{place}"
    messages: list[Any] = [
        {"topic": state, "payload": "ON" if body["active"] else "OFF", "qos": 1, "retain": True},
        {"topic": f"{target.topic}/alarm", "payload": json.dumps(body), "qos": 1},
    ]
    if target.discovery:
        name = f"rsenf_{place}".replace("/", "_").replace(".", "_")
        sensor = {
            "name": f"{body['camera']} {body['kind']}",
            "unique_id": name,
            "state_topic": state,
            "device_class": "problem",
            "device": {"identifiers": [f"rsenf_{body['site']}"], "name": f"rsenf {body['site']}"},
        }
        found = f"{target.discovery}/binary_sensor/{name}/config"
        messages.insert(
            0, {"topic": found, "payload": json.dumps(sensor), "qos": 1, "retain": True}
        )
    password = os.environ[target.password_env] if target.password_env else None
    tls: Any = {"cert_reqs": ssl.CERT_REQUIRED} if target.tls else None
    auth: Any = {"username": target.user, "password": password} if target.user else None
    logging.getLogger("paho").setLevel(logging.CRITICAL)  # of what goes wrong, it raises, too
    publish.multiple(
        messages, hostname=target.host, port=target.port, client_id=f"rsenf-{os.getpid()}",
        auth=auth, tls=tls,
    )  # fmt: skip


def _by_email(target: Any, body: dict[str, Any]) -> None:
    import smtplib
    import ssl
    from email.message import EmailMessage

    mail = EmailMessage()
    mail["From"], mail["To"] = target.sender, ", ".join(target.to)
    mail["Subject"] = f"rsenf {line_of(body)}".replace("\n", " ")[:200]
    mail["Message-ID"] = f"<{body['id']}@rsenf>"
    mail.set_content(f"{line_of(body)}\n\n{json.dumps(body, indent=2)}\n")
    with smtplib.SMTP(target.host, target.port, timeout=TIMEOUT_S) as server:
        if target.starttls:
            server.starttls(context=ssl.create_default_context())
        if target.user and target.password_env:
            server.login(target.user, os.environ[target.password_env])
        server.send_message(mail)


SENDERS: dict[str, Callable[[Any, dict[str, Any]], None]] = {
    "exec": _by_program,
    "webhook": _by_webhook,
    "mqtt": _by_mqtt,
    "email": _by_email,
}
