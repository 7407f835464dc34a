"""A headless Chromium, driven by its DevTools protocol."""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any

from rsenf.run.process import Patience

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
START_S = 20.0


def chromium() -> str:
    """Program of this machine; empty for none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), "")


class Browser:
    """One page, for a ``with`` block.

    Attributes
    ----------
    complaints : list of str
        What went to the console as an error or a warning, and what was thrown.
    requests : list of str
        Every address that was asked for.
    """

    def __init__(self) -> None:
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._number = 0
        self._open = contextlib.ExitStack()
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        words = [
            chromium(), "--headless=new", "--no-sandbox", "--disable-gpu", "--mute-audio",
            "--no-first-run", "--disable-background-networking", "--disable-dev-shm-usage",
            "--remote-debugging-port=0", f"--user-data-dir={self._folder.name}", "about:blank",
        ]  # fmt: skip
        self._process = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def __enter__(self) -> Browser:
        from websockets.sync.client import connect

        port_file = Path(self._folder.name) / "DevToolsActivePort"
        patience = Patience(START_S)
        while not (port_file.is_file() and port_file.read_text().count("\n")):
            assert self._process.poll() is None, "the browser didn't start"
            assert not patience.over, "the browser opens no port"
            time.sleep(0.05)
        port = port_file.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            pages = [p for p in json.load(answer) if p["type"] == "page"]
        # What it tells waits until something is asked: no reason to hang up.
        opened = connect(pages[0]["webSocketDebuggerUrl"], max_size=None, ping_interval=None)
        self._socket = self._open.enter_context(opened)
        for domain in ("Page", "Runtime", "Log", "Network", "Performance"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()
        self._process.terminate()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            said = json.loads(self._socket.recv())
            if said.get("id") == self._number:
                assert "error" not in said, said
                return dict(said.get("result", {}))
            self._note(said)

    def _note(self, said: dict[str, Any]) -> None:
        method, told = said.get("method"), said.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(told["exceptionDetails"])[:500])
        elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning"):
            self.complaints.append(json.dumps(told["args"])[:500])
        elif method == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.complaints.append(told["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])

    def open(self, url: str) -> None:
        """Go to a page."""
        self.call("Page.navigate", url=url)

    def value(self, expression: str) -> Any:
        """Value of an expression in the page."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str, timeout_s: float = 10.0) -> float:
        """Wait until an expression is true; returns how long it took."""
        begun, patience = time.monotonic(), Patience(timeout_s)
        while not self.value(f"Boolean({expression})"):
            if patience.over:
                text = self.value("document.body.innerText.slice(0, 1500)")
                raise AssertionError(f"not within {timeout_s} s: {expression}\n{text}")
            time.sleep(0.05)
        return time.monotonic() - begun

    def size(self, width: int, height: int, *, phone: bool = False, scale: float = 1.0) -> None:
        """Make the window so large."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=scale, mobile=phone)  # fmt: skip

    def dark(self, dark: bool) -> None:
        """Prefer dark or light colours."""
        preferred = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[preferred])

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Save a screenshot."""
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))

    def metrics(self) -> dict[str, float]:
        """JavaScript heap, nodes and the like, after the garbage was collected."""
        self.call("HeapProfiler.collectGarbage")
        return {m["name"]: m["value"] for m in self.call("Performance.getMetrics")["metrics"]}
