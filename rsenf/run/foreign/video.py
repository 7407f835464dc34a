"""One camera of a foreign file as an input like any other."""

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
        The file, which has pictures.
    camera : str
        Which camera, by its name or topic; the only one unless given.
    source : str
        What its messages say they come from.

    Raises
    ------
    UsageError
        When that camera isn't there, or several are and none is named.
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
        """Yield its frames, as many as can be decoded.

        Raises
        ------
        InputError
            When none can.
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
        """What of the file, and of its pictures, is lost."""
        return "; ".join(filter(None, [self._recording.lost, self._stream.loss]))

    @property
    def warnings(self) -> list[str]:
        """What the pictures' times leave open."""
        return self._stream.warnings
