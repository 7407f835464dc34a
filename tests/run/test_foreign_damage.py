"""However a foreign file is damaged: its frames or one of rsenf's own errors, nothing else.

By hand, many more: ``python -m tests.run.foreign_damage COUNT SEED``.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from foreign_damage import FORMS, damaged, outcome, samples
from foreign_files import still
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.errors import SchemaMismatch
from rsenf.run.foreign.pictures import Coded, RawPicture, cdr_reader, json_reader, protobuf_reader
from rsenf.run.foreign.stream import PictureStream, raw_luma

SCHEMAS = {
    cdr_reader: ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"],
    protobuf_reader: ["foxglove.CompressedVideo", "foxglove.RawImage"],
    json_reader: ["foxglove.CompressedImage", "foxglove.RawImage"],
}
READERS = [(make, name) for make, names in SCHEMAS.items() for name in names]


@pytest.fixture(scope="module")
def whole():
    return samples()


@pytest.mark.parametrize("form", FORMS)
def test_damaged_files(tmp_path, whole, form):
    """The chunk's checksum hides the decoders from most damage: half of the files have none."""
    rng = np.random.default_rng(1)
    ends = Counter(outcome(tmp_path, damaged(whole[form], rng)) for _ in range(10))
    assert not {end for end in ends if end.startswith("CRASH")}
    assert sum(ends.values()) == 10


@pytest.mark.parametrize(("make", "schema"), READERS, ids=lambda v: getattr(v, "__name__", v))
@settings(max_examples=40, deadline=None)
@given(payload=st.binary(max_size=80))
def test_any_bytes_are_a_picture_or_none(make, schema, payload):
    for given_bytes in (payload, b"\0\1\0\0" + payload, b'{"data": ' + payload + b"}"):
        try:
            picture = make(schema)(given_bytes)
        except SchemaMismatch:
            continue
        PictureStream("x", with_packets=True).feed(picture, 5)


@settings(max_examples=60, deadline=None)
@given(
    encoding=st.sampled_from(["mono8", "mono16", "yuv422", "bgr8", "bayer_rggb8", "32FC1", ""]),
    sizes=st.tuples(*[st.integers(0, 40) | st.sampled_from([2**16, 2**31, 2**32 - 1])] * 3),
    data=st.binary(max_size=3000),
)
def test_any_raw_picture_has_luma_or_is_refused(encoding, sizes, data):
    width, height, step = sizes
    try:
        luma = raw_luma(RawPicture(0, encoding, width, height, step, False, data))
    except SchemaMismatch:
        return
    assert luma.shape == (height, width)


@settings(max_examples=60, deadline=None)
@given(
    times=st.lists(st.tuples(*[st.integers(-(2**63), 2**63)] * 2), max_size=5),
    codec=st.sampled_from(["h264", "mjpeg", "png", "vp9"]),
)
def test_no_stamp_is_too_strange(times, codec):
    stream = PictureStream("x", with_packets=True)
    for stamp_ns, log_time_ns in times:
        stream.feed(RawPicture(stamp_ns, "mono8", 2, 2, 0, False, b"1234"), abs(log_time_ns))
        stream.feed(Coded(stamp_ns, codec, b"\0\0\1\x65abc"), abs(log_time_ns))
    stream.finish()


def test_stamps_that_are_centuries_apart():
    """Found by the study: a decoder can't count so far."""
    stream, luma = PictureStream("x"), still(np.full((24, 32), 90, np.uint8), ".jpg")
    assert len(stream.feed(Coded(5, "mjpeg", luma), 5)) == 1
    assert stream.feed(Coded(2**63 - 1, "mjpeg", luma), 6) == []
    assert stream.loss == "pictures without a stamp of the others' time: 1"
