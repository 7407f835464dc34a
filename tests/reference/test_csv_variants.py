"""The same reference, written in every way that is accepted."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from rsenf.reference import read_reference
from tests.reference.reference_files import T0_NS, read_rows, read_text, stamps, values

N = 120
FREQ = values(N)
UNIX_S = T0_NS // 10**9 + np.arange(N)


def table(header, times, separator=",", freq=FREQ, comma=False):
    cells = [f"{f:.4f}".replace(".", ",") if comma else f"{f:.4f}" for f in freq]
    rows = [f"{t}{separator}{c}" for t, c in zip(times, cells, strict=True)]
    return "\n".join([header.replace(",", separator), *rows]) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        table("time,frequency", stamps(N)),
        table("time,Hz", stamps(N, separator="T")),
        table("Timestamp,f", [f"{t}Z" for t in stamps(N, separator="T")]),
        table("utc,FREQ", [f"{t}.000" for t in stamps(N)]),
        table("DateTime,enf_hz", [f"{t}+00:00" for t in stamps(N)]),
        table("date,Frequency [Hz]", [t.replace("-", "/") for t in stamps(N)]),
        table("time,frequency_hz", UNIX_S),
        table("time,frequency", UNIX_S * 1000),
        table("time,frequency", UNIX_S.astype(float) + 0.0),
        table("time,frequency", stamps(N), separator=";"),
        table("time,frequency", stamps(N), separator=";", comma=True),
        table("time,frequency", stamps(N), separator="\t", comma=True),
        table('"time","frequency"', [f'"{t}"' for t in stamps(N)]),
        "\ufeff" + table("time,frequency", stamps(N)).replace("\n", "\r\n"),
        "# a remark\n\n" + table("time,frequency", stamps(N)),
        table("", stamps(N)).lstrip("\n"),
        "\n".join(
            ["id,frequency,quality,time"]
            + [f"{i},{f:.4f},ok,{t}" for i, (f, t) in enumerate(zip(FREQ, stamps(N), strict=True))]
        ),
        "\n".join(
            ["Date;Time;f"]
            + [f"{t[:10]};{t[11:]};{f:.4f}" for f, t in zip(FREQ, stamps(N), strict=True)]
        ),
    ],
)
def test_variants_say_the_same(tmp_path, text):
    reference = read_text(tmp_path, text)
    np.testing.assert_array_equal(reference.freq_hz, FREQ)
    np.testing.assert_array_equal(reference.readings, 1)
    assert (reference.t0_ns, reference.step_s, reference.nominal_hz) == (T0_NS, 1.0, 50.0)
    assert reference.grid == "grid"
    assert reference.name == "grid.csv"


def test_gzip_and_its_name(tmp_path):
    path = tmp_path / "mine.csv.gz"
    path.write_bytes(gzip.compress(table("time,frequency", stamps(N)).encode()))
    reference = read_reference(path)
    np.testing.assert_array_equal(reference.freq_hz, FREQ)
    assert reference.grid == "mine"
    assert len(reference.sha256) == 64


def test_utf_16_from_a_spreadsheet(tmp_path):
    path = tmp_path / "grid.txt"
    path.write_bytes(table("time,frequency", stamps(N), separator="\t").encode("utf-16"))
    np.testing.assert_array_equal(read_reference(path).freq_hz, FREQ)


@pytest.mark.parametrize("header", ["", "Hz\n", "frequency\n"])
def test_values_alone_need_a_step(tmp_path, header):
    text = header + "\n".join(f"{f:.4f}" for f in FREQ)
    reference = read_text(tmp_path, text, step_s=2.0, grid="ce")
    np.testing.assert_array_equal(reference.freq_hz, FREQ)
    assert (reference.t0_ns, reference.step_s, reference.grid) == (0, 2.0, "ce")
    assert any("start time unknown" in note for note in reference.notes)
    timed = read_text(tmp_path, text, step_s=2.0, start_utc_ns=T0_NS)
    assert timed.t0_ns == T0_NS


def test_seconds_from_a_start_have_no_date(tmp_path):
    reference = read_rows(tmp_path, [f"{i * 0.1:.1f},{f}" for i, f in enumerate(FREQ)], "t_s,Hz")
    np.testing.assert_array_equal(reference.freq_hz, FREQ)
    assert (reference.t0_ns, reference.step_s) == (0, 0.1)


def test_a_named_column_is_taken(tmp_path):
    rows = [
        f"{t},{60 + i * 1e-4:.4f},{f}" for i, (t, f) in enumerate(zip(stamps(N), FREQ, strict=True))
    ]
    reference = read_rows(tmp_path, rows, "time,Boston,frequency", column="boston")
    assert reference.nominal_hz == 60.0


def test_a_column_named_t_or_f_is_not_taken_twice(tmp_path):
    rows = [f"{i},{f}" for i, f in enumerate(FREQ)]
    np.testing.assert_array_equal(read_rows(tmp_path, rows, "t,value").freq_hz, FREQ)


def test_centre_stamps_begin_half_a_step_earlier(tmp_path):
    rows = [f"{t},{f}" for t, f in zip(stamps(N), FREQ, strict=True)]
    reference = read_rows(tmp_path, rows, stamp="centre")
    assert reference.t0_ns == T0_NS - 500_000_000


@pytest.mark.parametrize("step_ms", [100, 1000, 2000])
def test_step_is_found(tmp_path, step_ms):
    rows = [f"{t},{f}" for t, f in zip(stamps(N, step_ms), FREQ, strict=True)]
    reference = read_rows(tmp_path, rows)
    assert reference.step_s == step_ms / 1000
    assert reference.freq_hz.size == N
