"""A recording as an input of the one-process commands."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from rsenf.bus.keys import topic_of
from rsenf.errors import InputError, UsageError
from rsenf.messages import Header
from rsenf.record.reader import Recording
from rsenf.run.inputs import Input
from rsenf.run.replay.naming import FRAMES, VIDEO
from rsenf.run.replay.player import Player, Playing

WORDS = {"frames": "video", "rows": "row blocks", "track": "estimates"}


class Replayed(Input):
    """One topic of one camera of a recording.

    Parameters
    ----------
    recording : Recording
    camera : str
        Name of the camera; may be empty if there is only one.
    begin : str
        Topic to read: 'frames', 'rows' or 'track'.
    rate : float
        Recorded seconds per second; 0 for full speed.

    Raises
    ------
    UsageError
        When there is no such camera, or several and none is named.
    InputError
        When the recording has no such topic.
    """

    tells_arrival = True

    def __init__(
        self, recording: Recording, camera: str = "", begin: str = "rows", *, rate: float = 0.0
    ) -> None:
        path = recording.path
        self.name, self.path, self.begins_with = path.name, path, begin
        self._missing, self._taken = 0, 0
        self._loss = recording.lost
        topic = f"{_camera(recording, camera, begin)}/{begin}"
        self._player = Player(
            path, Playing(topics=(topic,), rate=rate), run_id="", clock_ns=time.time_ns
        )

    def messages(self) -> Iterator[Any]:
        """Yield all messages that can be read."""
        epoch, due = 0, 0
        for _, message in self._player:
            header: Header = message.header
            if header.is_end:
                break
            if header.epoch != epoch:
                epoch, due = header.epoch, 0
            self._missing += max(header.seq - due, 0)
            due = header.seq + 1
            self._taken += 1
            yield message
        self._loss = self._player.loss
        if not self._taken and self._loss:
            what = WORDS[self.begins_with]
            raise InputError(f"{self.path}: none of its {what} can be read", self._loss)

    @property
    def loss(self) -> str:
        """What could not be read of the file, in one line."""
        return self._loss

    @property
    def warnings(self) -> list[str]:
        """The number of messages missing in the recording, by sequence number."""
        what = WORDS[self.begins_with]
        return [f"{what} that were not recorded: {self._missing}"] if self._missing else []


def _camera(recording: Recording, camera: str, begin: str) -> str:
    """Return the camera to read: the one named, or the only one."""
    path, what = recording.path, WORDS[begin]
    topic = VIDEO if begin == FRAMES else begin
    cameras = [key.split("/")[-2] for key in recording.topics if topic_of(key) == topic]
    if not cameras:
        cut = "" if recording.complete else "is cut short and "
        raise InputError(
            f"{path} {cut}holds no {what}", f"record {topic!r}, or give the video itself"
        )
    names = ", ".join(cameras)
    if not camera and len(cameras) > 1:
        raise UsageError(f"{path} has several cameras: {names}", "choose one with --camera")
    if camera and camera not in cameras:
        raise UsageError(f"{path} has no {what} of camera {camera!r}", f"only of: {names}")
    return camera or names
