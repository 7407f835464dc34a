"""Damages files at random: bits, stretches, and of text also numbers, words, nesting and lines."""

from __future__ import annotations

import gzip
import io
import math
import re
import struct
import zipfile

import numpy as np

TEXT = (".csv", ".yaml", ".json", ".jsonl")
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
WORD = re.compile(rb"[\w.+-]+")
EXTREMES = (
    b"nan", b"inf", b"-inf", b"0", b"-0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e999", b"1_000",
    b"0x10", b"2147483648", b"9223372036854775808", b"-9223372036854775808", b"1" + b"0" * 400,
)  # fmt: skip
ODD = (
    b"null", b"true", b"[]", b"{}", b'""', b"~", b"- -", b"\xff\xfe", b"\0", "é".encode(), b"..",
    b"/", b"!!python/object:os.system", b"2026-13-45", b"''", b"*b1", b"${HOME}", b"${NOT_SET}",
)  # fmt: skip


def damaged(name: str, content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file at one to four places; half of the time within what checksums protect."""
    if rng.random() < 0.5:
        if name.endswith(".npz"):
            return _in_zip(content, rng)
        if name.endswith(".gz"):
            return gzip.compress(damaged(name.removesuffix(".gz"), gzip.decompress(content), rng))
        if name.endswith(".mcap"):
            content = without_checksums(content)
    for _ in range(min(4, rng.geometric(0.5))):
        textual = name.endswith(TEXT) and rng.random() < 0.7
        kinds = OF_TEXT if textual else OF_BYTES
        content = kinds[rng.integers(len(kinds))](content or b"0", rng)
    return content


def _in_zip(content: bytes, rng: np.random.Generator) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    name = list(parts)[rng.integers(len(parts))]
    parts[name] = damaged(name, parts[name], rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for part, inside in parts.items():
            archive.writestr(part, inside)
    return out.getvalue()


def without_checksums(content: bytes) -> bytes:
    """Zero the checksum of every chunk of an MCAP file: 'there is none'."""
    changed, at = bytearray(content), 8
    while at + 9 <= len(changed):
        kind, length = struct.unpack_from("<BQ", changed, at)
        if kind == 6:
            changed[at + 33 : at + 37] = bytes(4)
        at += 9 + length
    return bytes(changed)


def _stretch(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    """Any place, and a length that is of any order of magnitude."""
    start = int(rng.integers(len(content)))
    length = int(math.exp(rng.uniform(0, math.log(len(content) + 1))))
    return start, min(start + length, len(content))


def flip(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for at in rng.integers(0, len(content), int(rng.integers(1, 9))):
        changed[at] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def extreme(content: bytes, rng: np.random.Generator) -> bytes:
    """An integer becomes the largest, the smallest, or one near 0."""
    size = int(rng.choice([1, 2, 4, 8]))
    value = [b"\xff" * size, b"\xff" * (size - 1) + b"\x7f", bytes(size), b"\1" + bytes(size - 1),
             bytes(size - 1) + b"\x80", rng.bytes(size)][rng.integers(6)]  # fmt: skip
    at = int(rng.integers(len(content)))
    return content[:at] + value[:: int(rng.choice([1, -1]))] + content[at + size :]


def cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: rng.integers(len(content))]


def delete(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _stretch(content, rng)
    return content[:start] + content[stop:]


def blank(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _stretch(content, rng)
    return content[:start] + bytes(stop - start) + content[stop:]


def repeat(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _stretch(content, rng)
    return content[:stop] + content[start:stop] * int(rng.integers(1, 4)) + content[stop:]


def splice(content: bytes, rng: np.random.Generator) -> bytes:
    """A stretch comes to lie over another."""
    (start, stop), to = _stretch(content, rng), int(rng.integers(len(content)))
    return content[:to] + content[start:stop] + content[to + stop - start :]


def _replaced(
    content: bytes, pattern: re.Pattern[bytes], by: bytes, rng: np.random.Generator
) -> bytes:
    places = list(pattern.finditer(content))
    if not places:
        return content + by
    place = places[rng.integers(len(places))]
    return content[: place.start()] + by + content[place.end() :]


def number(content: bytes, rng: np.random.Generator) -> bytes:
    return _replaced(content, NUMBER, EXTREMES[rng.integers(len(EXTREMES))], rng)


def word(content: bytes, rng: np.random.Generator) -> bytes:
    """A word becomes another one of the file, or something odd."""
    words = WORD.findall(content)
    by = (
        words[rng.integers(len(words))]
        if words and rng.random() < 0.5
        else ODD[rng.integers(len(ODD))]
    )
    return _replaced(content, WORD, by, rng)


def nested(content: bytes, rng: np.random.Generator) -> bytes:
    opening, closing = [(b"[", b"]"), (b'{"a":', b"}"), (b"{a: ", b"}"), (b'"', b'"')][
        rng.integers(4)
    ]
    depth = int(rng.choice([1, 2, 40, 3000, 100_000]))
    return _replaced(content, WORD, opening * depth + b"1" + closing * depth, rng)


def aliases(content: bytes, rng: np.random.Generator) -> bytes:
    """Aliases of aliases (of YAML) in place of a value."""
    depth = int(rng.choice([2, 9, 30]))
    bomb = b"[&b0 [1,1,1,1,1,1,1,1,1],"
    bomb += b",".join(
        b"&b%d [%s]" % (k, b",".join([b"*b%d" % (k - 1)] * 9)) for k in range(1, depth)
    )
    return _replaced(content, WORD, bomb + b"]", rng)


def lines(content: bytes, rng: np.random.Generator) -> bytes:
    """A line (or a key of JSON with its value) is repeated, left out, or moved."""
    mark = b"\n" if content.count(b"\n") > 2 else b","
    parts = content.split(mark)
    at, to = (int(n) for n in rng.integers(0, len(parts), 2))
    kept = [] if rng.random() < 0.3 else [parts[at]]
    if rng.random() < 0.5:
        parts[to:to] = [parts[at]] * int(rng.choice([1, 2, 1000]))
    else:
        del parts[at]
        parts[to:to] = kept
    return mark.join(parts)


OF_BYTES = (flip, extreme, cut, delete, blank, repeat, splice)
OF_TEXT = (number, number, word, word, nested, aliases, lines)
