"""Means that the store keeps for a search from coarse to fine: those of its samples."""

from __future__ import annotations

import numpy as np
import pytest
from pyarrow import parquet

from rsenf.errors import ReferenceFormatError
from rsenf.match import MatchSettings
from rsenf.match import score as scoring
from rsenf.match.series import Track
from rsenf.reference import open_reference
from rsenf.reference.store import SampleFile, StoredSeries, all_series
from rsenf.reference.store.sample_file import MEAN_OF
from tests.match.match_clips import grid_from, wandering_grid
from tests.reference.reference_files import values
from tests.reference.store_files import BORDER, S, bring, write_csv

N = 400
START = BORDER - 203  # not at the start of a mean
FREQ = values(N)
ALL = np.arange(N)
# Samples of each import; those of the last list differ by 0.3 Hz from the others.
IMPORTS = {
    "one": [ALL],
    "with gaps": [np.flatnonzero(np.random.default_rng(1).random(N) < 0.6)],
    "side by side": [ALL[:83], ALL[83:163], ALL[163:]],
    "in one mean": [ALL[:87], ALL[87:]],
    "overlapping": [ALL[:250], ALL[200:]],
    "contradicting": [ALL, ALL[90:101]],
    "sparse": [ALL[::20]],
}
OF_SAMPLES = {"in one mean", "overlapping", "contradicting", "sparse"}  # in a block at least


@pytest.fixture(params=IMPORTS)
def store(request, tmp_path):
    for number, there in enumerate(IMPORTS[request.param]):
        freq_hz = FREQ[there] + 0.3 * (request.param == "contradicting" and number)
        path = write_csv(tmp_path / f"{number}.csv", START + there, freq_hz)
        bring(tmp_path / request.param, path, step_s=1.0)
    return tmp_path / request.param


def without_means(monkeypatch):
    monkeypatch.setattr(SampleFile, "has_means", property(lambda file: False))


@pytest.mark.parametrize("later_s", [0, 1, 5, 8])
def test_they_are_the_means_of_the_samples(store, later_s, monkeypatch):
    start = str(np.datetime64((START + later_s) * S, "ns"))[:19]
    reference = open_reference(f"store:ce@1?from={start}Z", store=store)
    many, before, kept = reference.freq_hz.means()
    assert many == MEAN_OF
    assert 0 <= before < many
    assert (reference.t0_ns // S + before) % many == 0
    rows = np.asarray(reference.freq_hz)[before:]
    rows = rows[: rows.size // many * many].reshape(-1, many)
    enough = np.isfinite(rows).sum(axis=1) >= many / 2
    found = np.asarray(kept)
    np.testing.assert_array_equal(np.isfinite(found), enough)
    np.testing.assert_allclose(found[enough], np.nanmean(rows[enough], axis=1), atol=1e-6, rtol=0)
    without_means(monkeypatch)
    np.testing.assert_array_equal(np.asarray(kept), found)


def test_samples_are_read_only_where_they_must_be(store, monkeypatch):
    read = []
    block = StoredSeries.block
    monkeypatch.setattr(StoredSeries, "block", lambda *given: read.append(1) or block(*given))
    (series,) = all_series(store)
    for number in series.groups:
        series.means(number)
    assert bool(read) == (store.name in OF_SAMPLES)


def of_older_version(path):
    """Rewrite an import as it was before it held means."""
    held = parquet.read_table(path)
    metadata = held.schema.metadata or parquet.read_metadata(path).metadata
    table = held.drop_columns(["mean_uhz"]).replace_schema_metadata(metadata)
    parquet.write_table(table, path, row_group_size=1 << 18)


def test_an_import_of_an_older_version_is_searched_and_imported_anew(tmp_path):
    path = write_csv(tmp_path / "a.csv", BORDER + ALL, FREQ)
    done = bring(tmp_path / "store", path)
    expected = [np.asarray(s) for s in _samples_and_means(tmp_path / "store")]
    of_older_version(done.path)
    assert not SampleFile(done.path).has_means
    for one, other in zip(_samples_and_means(tmp_path / "store"), expected, strict=True):
        np.testing.assert_array_equal(np.asarray(one), other)
    assert bring(tmp_path / "store", path).new
    assert SampleFile(done.path).has_means
    assert not bring(tmp_path / "store", path).new


def _samples_and_means(store):
    samples = open_reference("store:ce", store=store).freq_hz
    return samples, samples.means()[2]


def test_damaged_ones_are_refused(tmp_path):
    done = bring(tmp_path / "store", write_csv(tmp_path / "a.csv", BORDER + ALL, FREQ))
    column = parquet.read_metadata(done.path).row_group(0).column(5)
    raw = bytearray(done.path.read_bytes())
    at = column.data_page_offset
    raw[at : at + column.total_compressed_size] = bytes(column.total_compressed_size)
    done.path.write_bytes(raw)
    _, means = _samples_and_means(tmp_path / "store")
    with pytest.raises(ReferenceFormatError, match=r"\.parquet can't be read: "):
        means[:]


@pytest.mark.parametrize("lead", [0, 3])
def test_a_search_finds_the_same_with_them_and_without(lead, tmp_path, monkeypatch):
    rng = np.random.default_rng(4)
    freq_hz = np.round(wandering_grid(12_000, 5), 6)
    freq_hz[3000:3400] = np.nan
    track_hz = freq_hz[8003:8203] + 1e-3 * rng.standard_normal(200)
    track = Track(0.5, 1.0, 1.0, track_hz, np.full(200, 1e-6), 50.0)
    there = np.flatnonzero(np.isfinite(freq_hz))
    bring(tmp_path / "store", write_csv(tmp_path / "a.csv", BORDER + lead + there, freq_hz[there]))
    stored = grid_from(open_reference("store:ce", store=tmp_path / "store").freq_hz)
    plain = scoring.survey(track, grid_from(freq_hz), MatchSettings(), 50)
    monkeypatch.setattr(scoring, "PIECE", 1000)
    found = scoring.survey(track, stored, MatchSettings(), 50)
    without_means(monkeypatch)
    again = scoring.survey(track, stored, MatchSettings(), 50)
    np.testing.assert_array_equal(again.lag_s, found.lag_s)
    np.testing.assert_array_equal(again.score, found.score)
    assert (again.lags, again.possible, again.inside) == (found.lags, found.possible, found.inside)
    assert found.lag_s[0] == plain.lag_s[0] == pytest.approx(8003.0)
    assert found.score[0] == pytest.approx(plain.score[0], abs=1e-6)
    assert found.lags == pytest.approx(plain.lags, rel=0.01)
    assert found.inside / found.possible == pytest.approx(plain.inside / plain.possible, abs=0.02)
