"""Keyboard control of a player: space pauses, . steps, arrows seek, q ends."""

from __future__ import annotations

import os
import re
import select
import termios
import threading
import tty
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rsenf.run.replay.control import Control

HELP = "space: pause or go on; .: one message; ←/→: 10 s; ↓/↑: 60 s; q: end"
SEEKS_S = {"\x1b[D": -10.0, "\x1b[C": 10.0, "\x1b[B": -60.0, "\x1b[A": 60.0}
POLL_S = 0.1
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
        if select.select([terminal], [], [], POLL_S)[0]:
            typed = os.read(terminal, 64)
            if not typed:
                return
            yield from _KEY.findall(typed.decode(errors="replace"))
