"""References that hold deviations from the nominal frequency, in Hz or in mHz."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.errors import ReferenceFormatError
from rsenf.reference.plausible import without_outliers
from rsenf.reference.reference import Notes
from tests.reference.reference_files import read_rows, stamps, values

N = 600
OFF_HZ = np.round(values(N) - 50, 4)


def read(folder, name, off, **options):
    rows = [f"{t},{f:.4f}" for t, f in zip(stamps(N), off, strict=True)]
    return read_rows(folder, rows, f"time,{name}", **options)


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [
        ("deviation", 1000, "mHz"),
        ("mHz", 1000, "mHz"),
        ("Δf [mHz]", 1000, "mHz"),
        ("delta_f_mHz", 1000, "mHz"),
        ("Frequency (mHz)", 1000, "mHz"),
        ("frequency", 1000, "mHz"),
        ("f-50 [Hz]", 1, "Hz"),
        ("deviation", 1, "Hz"),
        ("Hz", 1, "Hz"),
    ],
)
def test_deviations_are_read_and_told(tmp_path, name, factor, unit):
    reference = read(tmp_path, name, factor * OFF_HZ, nominal_hz=50.0)
    np.testing.assert_allclose(reference.freq_hz, 50 + OFF_HZ, atol=1e-9)
    assert f"values are deviations in {unit} from 50 Hz" in reference.notes


def test_from_which_frequency_is_asked_for(tmp_path):
    with pytest.raises(ReferenceFormatError, match="Give --nominal-hz 50 or 60"):
        read(tmp_path, "deviation", 1000 * OFF_HZ)
    for told in ("nominal_hz", "assumed_hz"):
        assert read(tmp_path, "deviation", 1000 * OFF_HZ, **{told: 60.0}).nominal_hz == 60.0
    assert read(tmp_path, "Hz", 50 + OFF_HZ, assumed_hz=60.0).nominal_hz == 50.0


@pytest.mark.parametrize(
    ("name", "factor"),
    [("deviation", 1 / np.abs(OFF_HZ).max()), ("deviation [Hz]", 1000), ("mHz", 1)],
)
def test_a_unit_that_nothing_tells_or_that_can_t_be_is_asked_for(tmp_path, name, factor):
    with pytest.raises(ReferenceFormatError, match="in Hz or in mHz"):
        read(tmp_path, name, factor * OFF_HZ, nominal_hz=50.0)


def test_frequencies_in_mhz(tmp_path):
    reference = read(tmp_path, "f [mHz]", 1000 * (50 + OFF_HZ))
    np.testing.assert_allclose(reference.freq_hz, 50 + OFF_HZ, atol=1e-9)
    assert reference.nominal_hz == 50.0


def test_frequencies_stay_what_they_are(tmp_path):
    reference = read(tmp_path, "Hz", 50 + OFF_HZ, nominal_hz=50.0)
    np.testing.assert_array_equal(reference.freq_hz, np.round(50 + OFF_HZ, 4))
    assert not any("deviations" in line for line in reference.notes)


def test_values_at_the_ends_of_a_float_warn_nobody(tmp_path):
    ends = np.where(np.arange(N) == 100, 1e308, np.where(np.arange(N) == 300, -1e308, 50 + OFF_HZ))
    reference = read(tmp_path, "frequency", ends)
    assert np.isnan(reference.freq_hz[[100, 300]]).all()
    assert np.isfinite(reference.freq_hz).sum() >= N - 2


def test_infinity_is_no_frequency():
    notes = Notes()
    freq_hz = without_outliers(np.array([50.0, np.inf, np.nan, 49.98]), 50.0, notes)
    assert np.isnan(freq_hz).tolist() == [False, True, True, False]
    assert notes.lines[0].endswith(": 1")
