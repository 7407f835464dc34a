"""The reference node: what it sends is what the store, or a file, holds."""

from __future__ import annotations

from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from rsenf_nodes.reference import ReferenceNode

from rsenf.errors import UsageError
from rsenf.messages import Mark
from tests.reference.joined import joined
from tests.reference.reference_files import T0_NS, values
from tests.reference.store_files import bring, write_csv

DAY = T0_NS // 10**9


def sent(stop=None, **config):
    """Run the node's body without a bus; return what it published and what it said."""
    out, said = [], []
    node = SimpleNamespace(
        config=ReferenceNode(kind="reference", grid="grid1", **config),
        run_id="r",
        stop=stop or Event(),
        reference_publisher=lambda grid: SimpleNamespace(send=out.append),
        ready=lambda: None,
        wait_for_peers=lambda: None,
        say=lambda *words: said.append(words),
    )
    node.config.body(node)
    return out, said


@pytest.mark.parametrize(
    "spec", ["store:ce", "store:ce@1?from=2022-09-17T01:00&to=2022-09-17T02:00"]
)
def test_a_grid_of_the_store(tmp_path, spec):
    path = write_csv(tmp_path / "a.csv", DAY + np.arange(9000), values(9000))
    bring(tmp_path / "store", path)
    blocks, said = sent(input=spec, store=str(tmp_path / "store"))
    part = slice(3600, 7200) if "?" in spec else slice(None)
    back = joined(blocks[:-1])
    np.testing.assert_array_equal(back.freq_hz, values(9000)[part])
    assert (back.grid, back.t0_ns) == ("grid1", T0_NS + (part.start or 0) * 10**9)
    assert {b.header.source for b in blocks} == {"reference/grid1"}
    assert blocks[-1].header.mark == Mark.END
    assert "from the store: ce@1" in said[0][1]


def test_a_file(tmp_path):
    path = write_csv(tmp_path / "a.csv", DAY + np.arange(50), values(50))
    blocks, _ = sent(input=str(path))
    np.testing.assert_array_equal(blocks[0].freq_hz, values(50))


def test_a_grid_that_is_not_there(tmp_path):
    with pytest.raises(UsageError, match="no grid 'ce'"):
        sent(input="store:ce", store=str(tmp_path))


def test_who_is_told_to_stop_sends_no_more_than_the_end(tmp_path):
    stop = Event()
    stop.set()
    out, _ = sent(stop, input=str(write_csv(tmp_path / "a.csv", DAY + np.arange(100), values(100))))
    assert [message.header.mark for message in out] == [Mark.END]
