"""Provenance of a recording: program, libraries, host and input."""

from __future__ import annotations

import hashlib
import platform
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

from rsenf import __version__
from rsenf.errors import InputError, reason_of
from rsenf.messages.schema import message_classes

ADDED = "package "  # prefix for packages that extend rsenf
LIBRARIES = (
    "av", "eclipse-zenoh", "mcap", "numpy", "opencv-python-headless", "protobuf", "scipy",
    "zstandard",
)  # fmt: skip


def program_facts() -> dict[str, str]:
    """Return versions of the program, its schemas and libraries, and the host.

    If all but host and platform are equal, results are bit-identical.
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
    """Return versions of the packages that extend rsenf by entry points."""
    from importlib.metadata import distributions

    return {
        f"{ADDED}{found.name}": found.version
        for found in distributions()
        if any(point.group.startswith("rsenf.") for point in found.entry_points)
    }


def _arithmetic() -> str:
    """Return what determines rounding: processor, features used by NumPy, OpenBLAS and C library.

    OpenBLAS divides matrices by the sizes of the processor's caches, too.
    The environment can change them: ``NPY_DISABLE_CPU_FEATURES`` and ``OPENBLAS_CORETYPE``.
    """
    import numpy as np
    from threadpoolctl import threadpool_info

    used = np.show_config(mode="dicts")["SIMD Extensions"]
    # Only NumPy's OpenBLAS: SciPy's and OpenCV's may be loaded too, in any order, and an older
    # version has another name for the same processor.
    cores = {
        lib["architecture"]
        for lib in threadpool_info()
        if lib["internal_api"] == "openblas" and "numpy" in Path(lib["filepath"]).parent.name
    }
    words = [platform.machine(), *used["baseline"], *used.get("found", ()), *sorted(cores)]
    return " ".join([*words, *platform.libc_ver(), machine_facts()["processor"]])


def program_versions(libraries: Sequence[str]) -> dict[str, str]:
    """Return versions of the program, of Python and of libraries, without facts of the host."""
    from importlib import metadata  # takes 20 ms

    versions = {"rsenf": __version__, "python": sys.version.split()[0]}
    for name in libraries:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def machine_facts() -> dict[str, str]:
    """Return the names of operating system and processor."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        names = [line.partition(":")[2].strip() for line in text.splitlines() if "name\t" in line]
    except OSError:  # not Linux
        names = []
    return {
        "operating system": platform.platform(),
        "processor": next(iter(names), platform.processor() or platform.machine()),
    }


def input_facts(path: str | Path) -> dict[str, str]:
    """Return name, size and SHA-256 of an input file. Slow for large files: use another thread.

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
        raise InputError(f"{path}: {reason_of(exc)}") from exc
    return {"input": path.name, "input_sha256": digest, "input_bytes": str(size)}
