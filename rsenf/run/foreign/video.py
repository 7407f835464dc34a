"""One camera of a foreign file as an input of the one-process commands."""

from __future__ import annotations

from collections.abc import Iterator

from rsenf.errors import InputError
from rsenf.messages import Frame
from rsenf.record import Recording
from rsenf.run.foreign.cameras import choose_camera, picture_topics
from rsenf.run.foreign.finder import Finder
from rsenf.run.foreign.stream import Item, PictureStream
from rsenf.run.inputs import Input


class ForeignVideo(Input):
    """Frames of one camera of a foreign MCAP file.

    Parameters
    ----------
    recording : Recording
        A file with pictures.
    camera : str
        Name or topic of the camera; '' for the only one.
    source : str
        ``source`` of the message headers.

    Raises
    ------
    UsageError
        When there is no such camera, or several and none is named.
    """

    begins_with = "frames"
    tells_arrival = True

    def __init__(self, recording: Recording, camera: str, source: str) -> None:
        cameras = picture_topics(recording)
        self._topic = cameras[choose_camera(recording, cameras, camera)]
        self._recording, self._stream = recording, PictureStream(source)
        self.name, self.path = recording.path.name, recording.path
        found = recording.topics[self._topic]
        self.duration_s = (found.last_ns - found.first_ns) / 1e9

    def messages(self) -> Iterator[Frame]:
        """Yield all frames that can be decoded.

        Raises
        ------
        InputError
            When there is none.
        """
        some = False
        for item in self._items():
            if isinstance(item, Frame):
                some = True
                yield item
        if not some:
            raise InputError(f"{self._recording.path}: no picture can be decoded", self.loss)

    def _items(self) -> Iterator[Item]:
        for found in self._recording.found_by(Finder(frozenset([self._topic])), tolerant=True):
            yield from self._stream.feed(found.picture, found.log_time_ns)
        yield from self._stream.finish()

    @property
    def loss(self) -> str:
        """What could not be read of the file and its pictures, in one line."""
        return "; ".join(filter(None, [self._recording.lost, self._stream.loss]))

    @property
    def warnings(self) -> list[str]:
        """Warnings about the pictures' times, one line each."""
        return self._stream.warnings
