"""What a recording says of its own making: program, libraries, host and input."""

from __future__ import annotations

import hashlib
import platform
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

from rsenf import __version__
from rsenf.errors import InputError
from rsenf.messages.schema import message_classes

ADDED = "package "  # that adds to rsenf
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
    """Versions of the program, its schemas and its libraries, and the host it runs on.

    Where all but the host and its platform are the same, so is every bit that comes out.
    """
    versions = program_versions(LIBRARIES)
    return {
        "rsenf": versions.pop("rsenf"),
        "python": versions.pop("python"),
        "platform": platform.platform(),
        "arithmetic": _arithmetic(),
        "host": socket.gethostname(),
        **{f"schema {name}": str(cls.VERSION) for name, cls in message_classes().items()},
        **{f"library {name}": version for name, version in versions.items()},
        **_added(),
    }


def _added() -> dict[str, str]:
    """Versions of the packages that add to rsenf by entry points."""
    from importlib.metadata import distributions

    return {
        f"{ADDED}{found.name}": found.version
        for found in distributions()
        if any(point.group.startswith("rsenf.") for point in found.entry_points)
    }


def _arithmetic() -> str:
    """What rounds: the processor, as NumPy and its OpenBLAS make use of it now, and the C library.

    Both heed the environment: ``NPY_DISABLE_CPU_FEATURES`` and ``OPENBLAS_CORETYPE``.
    """
    import numpy as np
    from threadpoolctl import threadpool_info

    used = np.show_config(mode="dicts")["SIMD Extensions"]
    # NumPy's alone: a process may have loaded SciPy's and OpenCV's too, in any order, and an older
    # OpenBLAS calls the same processor by another name.
    cores = {
        lib["architecture"]
        for lib in threadpool_info()
        if lib["internal_api"] == "openblas" and "numpy" in Path(lib["filepath"]).parent.name
    }
    words = [platform.machine(), *used["baseline"], *used.get("found", ()), *sorted(cores)]
    return " ".join([*words, *platform.libc_ver()])


def program_versions(libraries: Sequence[str]) -> dict[str, str]:
    """Versions of the program, of Python and of libraries by name: nothing of the host."""
    from importlib import metadata  # 20 ms

    versions = {"rsenf": __version__, "python": sys.version.split()[0]}
    for name in libraries:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def machine_facts() -> dict[str, str]:
    """Operating system and processor, by the names that their makers give them."""
    try:
        told = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        names = [line.partition(":")[2].strip() for line in told.splitlines() if "name\t" in line]
    except OSError:  # not Linux
        names = []
    return {
        "operating system": platform.platform(),
        "processor": next(iter(names), platform.processor() or platform.machine()),
    }


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
