"""What a recording says of its own making: program, libraries, host and input."""

from __future__ import annotations

import hashlib
import platform
import socket
import sys
from pathlib import Path

from rsenf import __version__
from rsenf.errors import InputError
from rsenf.messages.schema import message_classes

LIBRARIES = (
    "av",
    "eclipse-zenoh",
    "mcap",
    "numpy",
    "opencv-python-headless",
    "protobuf",
    "scipy",
    "zstandard",
)


def program_facts() -> dict[str, str]:
    """Versions of the program, its schemas and its libraries, and the host it runs on."""
    from importlib import metadata  # 20 ms

    facts = {
        "rsenf": __version__,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "host": socket.gethostname(),
    }
    for name, cls in message_classes().items():
        facts[f"schema {name}"] = str(cls.VERSION)
    for name in LIBRARIES:
        try:
            facts[f"library {name}"] = metadata.version(name)
        except metadata.PackageNotFoundError:
            facts[f"library {name}"] = "not installed"
    return facts


def input_facts(path: str | Path) -> dict[str, str]:
    """Name, size and SHA-256 of an input file. Takes its time; let another thread call it.

    Raises
    ------
    InputError
        When the file can't be read.
    """
    path = Path(path)
    try:
        with open(path, "rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
            size = stream.tell()
    except OSError as exc:
        raise InputError(f"{path}: {(exc.strerror or str(exc)).lower()}") from exc
    return {"input": path.name, "input_sha256": digest, "input_bytes": str(size)}
