"""The cameras of a foreign file: its topics with pictures, under names that are valid in rsenf."""

from __future__ import annotations

import re

from rsenf.errors import UsageError
from rsenf.record import Recording
from rsenf.run.foreign.finder import holds_pictures


def picture_topics(recording: Recording) -> dict[str, str]:
    """Return the topics with pictures by camera name, in the file's order.

    Topic ``/front/image_raw`` becomes camera ``front_image_raw``.
    """
    names: dict[str, str] = {}
    for topic in recording.topics.values():
        if holds_pictures(topic.schema):
            plain = re.sub("[^A-Za-z0-9.-]+", "_", topic.name).strip("_.-")[:48] or "camera"
            name, number = plain, 1
            while name in names or name == "reference":
                number += 1
                name = f"{plain}_{number}"
            names[name] = topic.name
    return names


def choose_camera(recording: Recording, cameras: dict[str, str], camera: str) -> str:
    """Return the name of a camera.

    Parameters
    ----------
    recording : Recording
    cameras : dict of str to str
        As :func:`picture_topics` returns them.
    camera : str
        Its name or topic; '' for the only one.

    Raises
    ------
    UsageError
        When there is no such camera, or several and none is named.
    """
    there = ", ".join(cameras)
    if not camera and len(cameras) > 1:
        raise UsageError(
            f"{recording.path} has several cameras: {there}", "choose one with --camera"
        )
    for name, topic in cameras.items():
        if camera in ("", name, topic):
            return name
    raise UsageError(f"{recording.path} has no pictures of camera {camera!r}", f"only of: {there}")
