"""Converts a foreign file to a recording: pictures, frames, and the rows sampled from them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rsenf.bus.keys import camera_key
from rsenf.errors import InputError
from rsenf.messages import Frame, Header, Mark
from rsenf.record import Recorder, Recording, input_facts
from rsenf.rows.settings import RowsSettings
from rsenf.run.foreign.finder import Finder, choose_camera, picture_topics
from rsenf.run.foreign.stream import Item, PictureStream
from rsenf.run.runner import Runner
from rsenf.run.stages import rows_stage
from rsenf.whole_file import whole_file


@dataclass
class ConvertedCamera:
    """Result of one camera.

    Attributes
    ----------
    topic : str
        Topic of its pictures in the foreign file.
    frames : int
        Frames decoded.
    duration_s : float
        From the first to the last.
    loss : str
        What could not be decoded, in one line; empty for nothing.
    warnings : list of str
        One line each.
    """

    topic: str
    frames: int = 0
    duration_s: float = 0.0
    loss: str = ""
    warnings: list[str] = field(default_factory=list)


def import_pictures(
    recording: Recording,
    out: Path,
    *,
    site: str,
    camera: str = "",
    rows: RowsSettings,
    progress: Callable[[float], None] = lambda seconds: None,
) -> dict[str, ConvertedCamera]:
    """Make a recording of the pictures in a foreign file.

    Compressed pictures are copied; of raw ones the luma is kept, lossless, as PNG.

    Parameters
    ----------
    recording : Recording
        The foreign file. Unreadable parts are left out and counted in its loss.
    out : Path
        The new recording; the file appears once it is complete.
    site : str
        Site of the cameras in the new recording.
    camera : str, optional
        Name or topic of one camera; by default all are imported.
    rows : RowsSettings
        Settings of the rows stage.
    progress : callable, optional
        Called with the number of seconds done.

    Returns
    -------
    dict of str to ConvertedCamera
        Result of each camera.

    Raises
    ------
    InputError
        When there are no pictures, or none can be decoded.
    UsageError
        When there is no such camera.
    RecordingError
        When the recording can't be written.
    """
    cameras = picture_topics(recording)
    if not cameras:
        there = ", ".join(f"{t.name} ({t.schema})" for t in recording.topics.values()) or "none"
        raise InputError(f"{recording.path}: no pictures that are known", f"its topics: {there}")
    if camera:
        chosen = choose_camera(recording, cameras, camera)
        cameras = {chosen: cameras[chosen]}
    facts = input_facts(recording.path)
    with whole_file(out) as part:
        with Recorder(part, run_info={"site": site}, clock_ns=time.time_ns, fsync=False) as to:
            lanes = {topic: _Lane(to, site, name, topic, rows) for name, topic in cameras.items()}
            for found in recording.found_by(Finder(frozenset(lanes)), tolerant=True):
                lane = lanes[found.topic]
                lane.take(lane.stream.feed(found.picture, found.log_time_ns))
                progress(lane.done.duration_s)
            for lane in lanes.values():
                lane.end()
            to.add_metadata("rsenf.input.import", facts)
        done = {name: lanes[topic].done for name, topic in cameras.items()}
        if not any(one.frames for one in done.values()):
            lost = "; ".join(filter(None, [recording.lost, *(one.loss for one in done.values())]))
            raise InputError(f"{recording.path}: no picture can be decoded", lost)
    return done


class _Lane:
    """Conversion of one camera."""

    def __init__(
        self, recorder: Recorder, site: str, camera: str, topic: str, rows: RowsSettings
    ) -> None:
        self.stream = PictureStream(f"{site}/{camera}", with_packets=True)
        self.done = ConvertedCamera(topic)
        self._recorder, self._site, self._camera = recorder, site, camera
        self._sampler = Runner.of(rows_stage(rows), 1)
        self._first_ns = 0
        self._last: dict[type[Item], Header] = {}

    def take(self, items: list[Item]) -> None:
        """Record the packets and frames of a picture."""
        for item in items:
            if isinstance(item, Frame):
                if Frame not in self._last:
                    self._first_ns = item.header.pts_ns
                self.done.frames += 1
                self.done.duration_s = (item.header.pts_ns - self._first_ns) / 1e9
            self._record(item)

    def end(self) -> None:
        """Record the last frames of the decoder, and the END marks."""
        self.take(self.stream.finish())
        for kind, last in self._last.items():
            self._record(kind(header=last.numbered(last.seq + 1, Mark.END)))
        self.done.loss, self.done.warnings = self.stream.loss, self.stream.warnings

    def _record(self, item: Item) -> None:
        self._last[type(item)] = item.header
        self._write("frames" if isinstance(item, Frame) else "video", item)
        for block in self._sampler.feed(item) if isinstance(item, Frame) else ():
            self._write("rows", block)

    def _write(self, topic: str, message: object) -> None:
        self._recorder.write(camera_key(self._site, self._camera, topic), message)
