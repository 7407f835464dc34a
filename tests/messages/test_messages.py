"""Messages survive the wire; the published schema and its fast twin are one wire form."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given
from hypothesis import strategies as st

from rsenf.cli.explain import schema_files
from rsenf.errors import SchemaMismatch
from rsenf.messages import (
    EnfEstimate,
    Frame,
    Header,
    MatchResult,
    RowBlock,
    canonical,
    class_for,
    decode,
    descriptor_set,
    digest,
    encode,
    encoding_of,
    schema,
)
from rsenf.messages.schema import field_specs, message_classes
from tests.conftest import ROOT


def sample_of(cls: type[Any], seed: int = 0) -> Any:
    """A message with every field set to something."""
    rng = np.random.default_rng(seed)
    values: dict[str, Any] = {}
    specs = field_specs(cls)
    dims = {name: int(rng.integers(1, 4)) for s in specs for name in s.shape}
    for spec in specs:
        classes = message_classes()
        if spec.kind == "array":
            shape = tuple(dims[n] for n in spec.shape) or (3,)
            kinds = {"float": "f4", "double": "f8", "sfixed64": "i8", "fixed32": "u4"}
            value: Any = (rng.random(shape) * 1000).astype(kinds[spec.wire])
        elif spec.kind == "message":
            value = sample_of(classes[spec.wire], seed + 1)
        elif spec.kind == "repeated":
            inner = classes.get(spec.wire)
            value = (sample_of(inner, seed + 2),) if inner else ("one", "zwei")
        elif spec.name in dims:
            value = dims[spec.name]
        else:
            value = {
                "int64": int(rng.integers(-(2**62), 2**62)), "double": float(rng.normal()),
                "string": "größe", "bytes": b"\x00\xff", "bool": True,
            }[spec.wire]  # fmt: skip
        values[spec.name] = value
    return cls(**values)


def assert_same(a: Any, b: Any) -> None:
    for f in dataclasses.fields(a):
        if not f.metadata:
            continue
        x, y = getattr(a, f.name), getattr(b, f.name)
        if isinstance(x, np.ndarray):
            assert x.dtype == y.dtype
            np.testing.assert_array_equal(x, y)
        elif dataclasses.is_dataclass(x):
            assert_same(x, y)
        elif isinstance(x, tuple) and x and dataclasses.is_dataclass(x[0]):
            for p, q in zip(x, y, strict=True):
                assert_same(p, q)
        else:
            assert x == y or (isinstance(x, float) and math.isnan(x) and math.isnan(y)), f.name


@pytest.mark.parametrize("name", message_classes())
def test_round_trip(name: str) -> None:
    cls = message_classes()[name]
    message = sample_of(cls)
    assert_same(message, decode(cls, encode(message)))
    # Unknown stays unknown: a NaN is not lost as a default.
    empty = cls() if name == "Header" else cls(header=Header()) if hasattr(cls, "header") else cls()
    assert_same(empty, decode(cls, encode(empty)))


@pytest.mark.parametrize("name", message_classes())
def test_published_schema_reads_the_twin_and_writes_the_same_bytes(name: str) -> None:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(descriptor_set()).file:
        pool.Add(file)
    published = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"rsenf.{name}"))
    message = sample_of(message_classes()[name], seed=3)
    payload = encode(message)
    parsed = published.FromString(payload)
    assert parsed.SerializeToString(deterministic=True) == payload
    for spec in field_specs(type(message)):
        if spec.kind == "array":
            ours = getattr(message, spec.name).ravel()
            np.testing.assert_array_equal(np.array(getattr(parsed, spec.name), ours.dtype), ours)


def test_field_numbers_are_unique_and_fixed() -> None:
    for cls in message_classes().values():
        numbers = [s.number for s in field_specs(cls)]
        assert len(set(numbers)) == len(numbers)
        assert not any(19000 <= n < 20000 for n in numbers)


def test_generated_schemas_are_not_stale() -> None:
    for name, content in schema_files().items():
        stored = (ROOT / "configs" / "schema" / name).read_bytes()
        assert stored == content, (
            f"{name} is stale: run 'rsenf explain schemas --out configs/schema'"
        )


def test_canonical_leaves_out_arrival_and_run_only() -> None:
    header = Header(run_id="a", source="s/c", seq=4, arrival_time_ns=5, pts_ns=7)
    one = MatchResult(header=header, lag_s=3.0)
    same = dataclasses.replace(
        one, header=dataclasses.replace(header, run_id="b", arrival_time_ns=9)
    )
    other = dataclasses.replace(one, header=dataclasses.replace(header, seq=5))
    assert canonical(one) == canonical(same)
    assert canonical(one) != canonical(other)
    assert digest([one, one]) != digest([one])


def test_encoding_names_schema_and_version() -> None:
    assert encoding_of(RowBlock) == "application/protobuf;rsenf.RowBlock/1"
    assert class_for(encoding_of(EnfEstimate)) is EnfEstimate
    for foreign in ("", "text/plain", "application/protobuf;rsenf.RowBlock/2", "x;rsenf.Frame/1"):
        with pytest.raises(SchemaMismatch):
            class_for(foreign)


def test_array_that_does_not_fit_its_shape_is_refused() -> None:
    block = RowBlock(header=Header(), frames=1, rows=2, strips=1, level=np.ones((1, 2, 1), "f4"))
    payload = encode(block).replace(b"\x20\x02", b"\x20\x03")  # rows = 4: 2 -> 3
    with pytest.raises(SchemaMismatch, match="level"):
        decode(RowBlock, payload)
    with pytest.raises(ValueError, match="level"):
        encode(dataclasses.replace(block, rows=3))


@given(st.binary(max_size=200), st.sampled_from(sorted(message_classes())))
def test_foreign_bytes_are_refused_or_read_but_never_crash(payload: bytes, name: str) -> None:
    with contextlib.suppress(SchemaMismatch):
        decode(message_classes()[name], payload)


def test_frame_never_puts_its_plane_on_the_wire() -> None:
    frame = Frame(header=Header(), height_px=2, width_px=2, luma=np.full((2, 2), 9, np.uint8))
    assert decode(Frame, encode(frame)).luma is None


def test_threads_that_encode_first_at_once_share_one_set_of_classes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A node's health thread and its body both begin by sending."""
    described = schema.file_descriptor

    def slowly(*, twin: bool = False) -> Any:
        time.sleep(0.05)
        return described(twin=twin)

    monkeypatch.setattr(schema, "file_descriptor", slowly)
    schema._twin_classes.cache_clear()
    schema._twins.clear()
    with ThreadPoolExecutor(4) as threads:
        classes = list(threads.map(schema.twin_class, [Header] * 4))
    assert len(set(classes)) == 1
