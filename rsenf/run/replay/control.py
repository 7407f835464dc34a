"""Controls of a player while it plays: pause, step, seek, stop; and its pace.

On the keyboard: space pauses, . steps, arrows seek, q ends.
"""

from __future__ import annotations

import os
import re
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Condition, Event

from rsenf.timebase import NS_PER_S

POLL_S = 0.05
# Frames stored in coding order go back in time by less than this.
REORDERED_NS = 2 * NS_PER_S


class Control:
    """Remote control of a player. Thread-safe.

    Parameters
    ----------
    stop : Event, optional
        Ends the replay when it is set.
    """

    def __init__(self, stop: Event | None = None) -> None:
        self.stop = stop or Event()
        self.paused = False
        self._steps = 0
        self._seek_s: float | None = None
        self._change = Condition()

    def pause(self) -> None:
        """Pause or resume."""
        with self._change:
            self.paused = not self.paused
            self._steps = 0
            self._change.notify_all()

    def step(self) -> None:
        """Pause, and let one more message pass."""
        with self._change:
            self._steps += self.paused
            self.paused = True
            self._change.notify_all()

    def seek(self, by_s: float) -> None:
        """Jump forward by some seconds, or back if they are negative."""
        with self._change:
            self._seek_s = (self._seek_s or 0.0) + by_s
            self._change.notify_all()

    def sought_s(self) -> float | None:
        """Return and clear the pending jump in seconds; None for none."""
        with self._change:
            seek_s, self._seek_s = self._seek_s, None
            return seek_s

    def admit(self, left_s: Callable[[], float]) -> bool:
        """Wait until a message may pass; return False when the player must seek or stop instead.

        Parameters
        ----------
        left_s : callable
            Returns the seconds until the message is due, apart from pauses.
        """
        with self._change:
            while not self.stop.is_set() and self._seek_s is None:
                if self._steps:
                    self._steps -= 1
                    return True
                wait_s = POLL_S if self.paused else left_s()
                if wait_s <= 0:
                    return True
                self._change.wait(min(wait_s, POLL_S))
            return False


class Pace:
    """Maps recorded times to due times.

    Where recorded time jumps back, since a recording may hold several passes, the pace restarts.

    Parameters
    ----------
    rate : float
        Recorded seconds per second; 0 for as fast as the receiver takes messages.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._anchor: tuple[float, int] | None = None
        self._latest_ns = 0

    def restart(self) -> None:
        """Make the next message due now."""
        self._anchor = None

    def left_s(self, time_ns: int) -> float:
        """Return the seconds until a recorded time is due; below 0 when it is late."""
        if not self._rate:
            return 0.0
        now_s = time.monotonic()
        if self._anchor is None or time_ns < self._latest_ns - REORDERED_NS:
            self._anchor, self._latest_ns = (now_s, time_ns), time_ns
        self._latest_ns = max(self._latest_ns, time_ns)
        begun_s, begun_ns = self._anchor
        return begun_s + (time_ns - begun_ns) / NS_PER_S / self._rate - now_s


HELP = "space: pause or go on; .: one message; ←/→: 10 s; ↓/↑: 60 s; q: end"
SEEKS_S = {"\x1b[D": -10.0, "\x1b[C": 10.0, "\x1b[B": -60.0, "\x1b[A": 60.0}
KEY_POLL_S = 0.1
_KEY = re.compile(r"\x1b\[[A-D]|.", re.DOTALL)


def obey(keys: Iterable[str], control: Control) -> None:
    """Apply keys to a player's control, until there are no more."""
    for key in keys:
        if key == " ":
            control.pause()
        elif key == ".":
            control.step()
        elif key in SEEKS_S:
            control.seek(SEEKS_S[key])
        elif key == "q":
            control.stop.set()


@contextmanager
def keyboard(terminal: int, control: Control) -> Iterator[None]:
    """Control a player by a terminal's keys for the duration of a ``with`` block.

    Parameters
    ----------
    terminal : int
        File descriptor; its settings are restored at the end.
    control : Control
        Control of the player.
    """
    before = termios.tcgetattr(terminal)
    ended = threading.Event()
    tty.setcbreak(terminal)
    thread = threading.Thread(target=obey, args=(_keys(terminal, ended), control), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _keys(terminal: int, ended: threading.Event) -> Iterator[str]:
    while not ended.is_set():
        if select.select([terminal], [], [], KEY_POLL_S)[0]:
            typed = os.read(terminal, 64)
            if not typed:
                return
            yield from _KEY.findall(typed.decode(errors="replace"))
