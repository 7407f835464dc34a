"""A reference as messages and back; measured files as they are."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.messages import ReferenceBlock, decode, encode
from rsenf.reference import read_reference, reference_blocks
from tests.reference.joined import joined
from tests.reference.reference_files import read_stamped, stamps, values


def test_blocks_carry_everything_across_the_wire(tmp_path):
    times, freq = stamps(1000), values(1000)
    keep = [i for i in range(1000) if not 300 <= i < 420]
    reference = read_stamped(tmp_path, [times[i] for i in keep], freq[keep])
    blocks = list(reference_blocks(reference, source="reference/ce", run_id="r", block=333))
    assert [b.samples for b in blocks] == [333, 333, 333, 1]
    assert [b.header.seq for b in blocks] == [0, 1, 2, 3]
    assert [b.header.pts_ns for b in blocks] == [0, 333 * 10**9, 666 * 10**9, 999 * 10**9]
    assert {b.total for b in blocks} == {1000}
    sent = [decode(ReferenceBlock, encode(b)) for b in blocks]
    back = joined(sent[::-1])
    np.testing.assert_array_equal(back.freq_hz, reference.freq_hz)
    np.testing.assert_array_equal(back.readings, reference.readings)
    assert (back.grid, back.nominal_hz) == (reference.grid, reference.nominal_hz)
    assert (back.t0_ns, back.step_s) == (reference.t0_ns, reference.step_s)


@pytest.mark.measured
def test_measured_day(measured_data):
    reference = read_reference(measured_data / "grid_ce_2022-09-17_1s.csv.gz")
    assert reference.freq_hz.size == reference.valid_samples == 86_400
    assert reference.gaps == 0
    assert np.std(reference.freq_hz) == pytest.approx(19.4e-3, abs=0.1e-3)
    assert reference.freq_hz[:2].tolist() == [49.981593, 49.98074]


@pytest.mark.measured
def test_measured_week_with_its_gaps(measured_data):
    reference = read_reference(measured_data / "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz")
    assert reference.valid_samples == 448_035
    assert reference.gaps == 444
    assert reference.duplicates == 0
    assert 1 - reference.valid_samples / reference.freq_hz.size == pytest.approx(0.31, abs=0.01)
    minutes = read_reference(measured_data / "grid_ce_2024-08-19_152602_1s.csv")
    lag = (minutes.t0_ns - reference.t0_ns) // 10**9
    difference = reference.freq_hz[lag : lag + 517] - minutes.freq_hz
    assert np.sqrt(np.nanmean(difference**2)) < 0.1e-3
