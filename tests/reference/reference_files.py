"""Reference files written for a test."""

from __future__ import annotations

import struct

import numpy as np

from rsenf.reference import read_reference

T0 = np.datetime64("2022-09-17T00:00:00", "ns")
T0_NS = int(T0.astype(np.int64))


def values(count, seed=0, nominal_hz=50.0):
    rng = np.random.default_rng(seed)
    return np.round(nominal_hz + 0.02 * np.cumsum(rng.standard_normal(count)) / 10, 4)


def stamps(count, step_ms=1000, separator=" "):
    times = T0 + np.arange(count) * np.timedelta64(step_ms, "ms")
    unit = "s" if step_ms % 1000 == 0 else "ms"
    return [str(t).replace("T", separator) for t in times.astype(f"datetime64[{unit}]")]


def read_text(folder, text, name="grid.csv", **options):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return read_reference(path, **options)


def read_rows(folder, rows, header="time,frequency", **options):
    return read_text(folder, "\n".join([header, *rows]) + "\n", **options)


def read_stamped(folder, times, freq_hz, **options):
    return read_rows(folder, [f"{t},{f}" for t, f in zip(times, freq_hz, strict=True)], **options)


def write_wav(path, signal, rate_hz, bits=16, channels=1, extensible=False, is_float=False):
    """Write −1…1 samples into the first channel, noise into the others."""
    rng = np.random.default_rng(1)
    frames = np.stack([signal, *(0.3 * rng.standard_normal((channels - 1, signal.size)))], axis=1)
    frames = np.clip(frames, -1, 1)
    if is_float:
        raw, bits = frames.astype("<f4").tobytes(), 32
    elif bits == 8:
        raw = np.round(frames * 127 + 128).astype(np.uint8).tobytes()
    else:
        wide = np.round(frames * (2 ** (bits - 1) - 1)).astype("<i4")
        raw = wide.view(np.uint8).reshape(-1, 4)[:, : bits // 8].tobytes()
    coding = 3 if is_float else 1
    width = bits // 8 * channels
    layout = struct.pack(
        "<HHIIHH", 0xFFFE if extensible else coding, channels, rate_hz, rate_hz * width, width, bits
    )
    if extensible:
        guid = bytes.fromhex("000000001000800000aa00389b71")
        layout += struct.pack("<HHI", 22, bits, 0) + struct.pack("<H", coding) + guid
    junk = b"LIST" + struct.pack("<I", 3) + b"abc\0"
    chunks = b"fmt " + struct.pack("<I", len(layout)) + layout + junk
    chunks += b"data" + struct.pack("<I", len(raw)) + raw
    path.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks)
    return path
