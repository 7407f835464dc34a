"""Pictures of ROS 2 and Foxglove become frames with their own stamps, and a recording."""

from __future__ import annotations

import json

import numpy as np
import pytest
from foreign_files import (
    RATE_HZ,
    SECOND_NS,
    STAMP_NS,
    foxglove_json,
    foxglove_protobuf,
    h264_packets,
    ros_compressed,
    ros_image,
    ros_video,
    ros_wall,
    still,
    wall_luma,
    write_mcap,
)

from rsenf.cli import main
from rsenf.errors import InputError, UsageError
from rsenf.messages import Frame, Mark, RowBlock, VideoPacket
from rsenf.record import open_recording
from rsenf.run.foreign.pictures import RawPicture
from rsenf.run.foreign.stream import raw_luma
from rsenf.run.inputs import open_input_file

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
VIDEO, PICTURE, RAW = (f"foxglove.{n}" for n in ("CompressedVideo", "CompressedImage", "RawImage"))


def frames_of(path, **options):
    source = open_input_file(path, **options)
    return source, list(source.messages())


@pytest.mark.parametrize("order", ["<", ">"])
def test_ros_pictures_become_frames_at_their_stamps(tmp_path, order):
    source, frames = frames_of(ros_wall(tmp_path / "a.mcap", 20, order))
    assert (source.begins_with, source.loss, source.warnings) == ("frames", "", [])
    for k, ((stamp_ns, luma), frame) in enumerate(zip(wall_luma(20), frames, strict=True)):
        assert np.array_equal(frame.luma, luma)
        header = frame.header
        assert (header.seq, header.frame_first, header.frame_last) == (k, k, k)
        assert header.pts_ns == stamp_ns - STAMP_NS  # not the jittery time of logging
        assert header.camera_time_ns == stamp_ns
        assert header.arrival_time_ns > stamp_ns


def messages_of(form, count=6):
    """The wall in one of the forms that pictures come in, without loss."""
    for stamp_ns, luma in wall_luma(count):
        height, width = luma.shape
        size = {"width": width, "height": height, "step": width, "encoding": "mono8"}
        png, raw = still(luma, ".png"), luma.tobytes()
        yield {
            "ros png": ("cdr", COMPRESSED, ros_compressed(stamp_ns, "mono8; png compressed", png)),
            "ros be": ("cdr", COMPRESSED, ros_compressed(stamp_ns, "png", png, ">")),
            "protobuf raw": ("protobuf", RAW, foxglove_protobuf(RAW, stamp_ns, data=raw, **size)),
            "protobuf png": (
                "protobuf", PICTURE, foxglove_protobuf(PICTURE, stamp_ns, data=png, format="png")
            ),
            "json raw": ("json", RAW, foxglove_json(stamp_ns, data=raw, **size)),
            "json png": ("json", PICTURE, foxglove_json(stamp_ns, data=png, format="png")),
        }[form], stamp_ns  # fmt: skip


@pytest.mark.parametrize(
    "form", ["ros png", "ros be", "protobuf raw", "protobuf png", "json raw", "json png"]
)
def test_every_form_gives_the_same_frames(tmp_path, form):
    written = [("/cam", *message, stamp_ns) for message, stamp_ns in messages_of(form)]
    _, frames = frames_of(write_mcap(tmp_path / "a.mcap", written))
    for (stamp_ns, luma), frame in zip(wall_luma(6), frames, strict=True):
        assert np.array_equal(frame.luma, luma)
        assert frame.header.camera_time_ns == stamp_ns


@pytest.mark.parametrize("form", ["protobuf", "json", "cdr"])
def test_video_is_decoded_and_kept_as_it_is(tmp_path, form):
    packets = h264_packets(25)
    written = []
    for k, data in enumerate(packets):
        stamp_ns = STAMP_NS + k * SECOND_NS // RATE_HZ
        schema, payload = {
            "protobuf": (VIDEO, foxglove_protobuf(VIDEO, stamp_ns, data=data, format="h264")),
            "json": (VIDEO, foxglove_json(stamp_ns, data=data, format="h264")),
            "cdr": ("foxglove_msgs/msg/CompressedVideo", ros_video(stamp_ns, "h264", data)),
        }[form]
        written.append(("video", form, schema, payload, stamp_ns))
    path = write_mcap(tmp_path / "a.mcap", written)
    assert main(["import", str(path), "--out", str(tmp_path / "b.mcap"), "--site", "lab"]) == 0
    recording = open_recording(tmp_path / "b.mcap")
    assert recording.complete
    by_topic = {topic: [] for topic in recording.topics}
    for topic, message, _ in recording.messages():
        by_topic[topic].append(message)
    assert set(by_topic) == {f"rsenf/lab/video/{t}" for t in ("frames", "video", "rows")}
    kept, frames = by_topic["rsenf/lab/video/video"], by_topic["rsenf/lab/video/frames"]
    assert [m.data for m in kept if m.header.mark == Mark.DATA] == packets
    assert [m.keyframe for m in kept[:-1]] == [k % 10 == 0 for k in range(25)]
    assert [m.header.pts_ns for m in frames[:-1]] == [m.header.pts_ns for m in kept[:-1]]
    assert {type(kept[0]), type(frames[0])} == {VideoPacket, Frame}
    assert all(messages[-1].header.is_end for messages in by_topic.values())


def test_an_imported_recording_gives_the_rows_that_the_file_itself_gives(tmp_path):
    path, new = ros_wall(tmp_path / "a.mcap", 40), tmp_path / "b.mcap"
    assert main(["import", str(path), "--out", str(new), "--read-out", "rows"]) == 0
    from rsenf.rows.settings import RowsSettings
    from rsenf.rows.stage import Rows

    stage = Rows(RowsSettings())
    _, frames = frames_of(path)
    expected = [block for frame in frames for block in stage.update(frame)] + stage.flush()
    blocks = list(open_input_file(new).messages())
    assert len(blocks) == len(expected) == 5
    for ours, theirs in zip(blocks, expected, strict=True):
        assert isinstance(ours, RowBlock)
        assert np.array_equal(ours.level, theirs.level)
        assert np.array_equal(ours.frame_pts_ns, theirs.frame_pts_ns)
    # Raw pictures are kept without loss.
    packets = [
        m for t, m, _ in open_recording(new).messages() if t.endswith("/video") and m.data
    ]  # fmt: skip
    import cv2

    for (_, luma), packet in zip(wall_luma(40), packets, strict=True):
        kept = cv2.imdecode(np.frombuffer(packet.data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(kept, luma)


def test_a_foreign_file_is_tracked_as_it_is(tmp_path, capsys):
    path = ros_wall(tmp_path / "a.mcap", 20 * RATE_HZ)
    assert main(["track", str(path), "--json", "--read-out", "rows"]) == 0
    values = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    usable = [value["enf_hz"] for value in values if value["usable"]]
    assert len(usable) >= 15
    assert np.allclose(usable, 50.01, atol=0.002)


def test_several_cameras(tmp_path, capsys):
    one = [("/front/image", *m, t) for m, t in messages_of("protobuf raw")]
    two = [("/rear/image", *m, t) for m, t in messages_of("ros png")]
    path = write_mcap(tmp_path / "a.mcap", [m for pair in zip(one, two, strict=True) for m in pair])
    with pytest.raises(UsageError, match="several cameras: front_image, rear_image"):
        open_input_file(path)
    for name in ("rear_image", "/rear/image"):
        assert len(frames_of(path, camera=name)[1]) == 6
    with pytest.raises(UsageError, match="no pictures of camera 'roof'"):
        open_input_file(path, camera="roof")
    assert main(["import", str(path), "--out", str(tmp_path / "b.mcap"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {name: done["frames"] for name, done in said["cameras"].items()} == {
        "front_image": 6,
        "rear_image": 6,
    }


def test_pictures_without_stamps_go_by_their_logging(tmp_path):
    written = [
        ("/cam", "cdr", IMAGE, ros_image(0, "mono8", *m.shape, 0, m.tobytes()), t)
        for t, m in wall_luma(4)
    ]
    source, frames = frames_of(write_mcap(tmp_path / "a.mcap", written))
    assert [f.header.pts_ns for f in frames] == [t - STAMP_NS for t, _ in wall_luma(4)]
    assert {f.header.camera_time_ns for f in frames} == {0}
    assert "bear no times" in source.warnings[0]


def test_a_picture_without_a_stamp_among_others_is_left_out_and_counted(tmp_path, capsys):
    good = [("/cam", *m, t) for m, t in messages_of("ros png")]
    unset = (
        "/cam",
        "cdr",
        COMPRESSED,
        ros_compressed(0, "png", still(next(iter(wall_luma(1)))[1], ".png")),
        STAMP_NS,
    )
    path = write_mcap(tmp_path / "a.mcap", [*good[:3], unset, *good[3:]])
    assert main(["import", str(path), "--out", str(tmp_path / "b.mcap")]) == 3
    assert "pictures without a stamp of the others' time: 1" in capsys.readouterr().err
    _, frames = frames_of(path)
    assert [f.header.pts_ns for f in frames] == [t - STAMP_NS for t, _ in wall_luma(6)]


def test_a_camera_whose_encoding_is_unknown_is_a_loss(tmp_path, capsys):
    good = [("/cam", *m, t) for m, t in messages_of("ros png")]
    other = [("/fb", "flatbuffer", COMPRESSED, b"?" * 40, STAMP_NS + k) for k in range(5)]
    path = write_mcap(tmp_path / "a.mcap", [*good, *other])
    assert main(["import", str(path), "--out", str(tmp_path / "b.mcap")]) == 3
    error = capsys.readouterr().err
    why = f"topic /fb: {COMPRESSED} encoded as 'flatbuffer' isn't known"
    assert f"messages that can't be read: 5 ({why})" in error
    path = write_mcap(tmp_path / "c.mcap", other)
    assert main(["import", str(path), "--out", str(tmp_path / "d.mcap")]) == 1
    assert why in capsys.readouterr().err


def test_pictures_that_are_none_are_counted(tmp_path, capsys):
    good = [("/cam", *m, t) for m, t in messages_of("ros png")]
    cut = still(np.eye(9, dtype=np.uint8), ".png")[:40]
    bad = [
        ("/cam", "cdr", COMPRESSED, payload, STAMP_NS)
        for payload in (
            b"\0\1\0\0" + bytes(3),
            ros_compressed(STAMP_NS, "gif", b"GIF89a"),
            ros_compressed(STAMP_NS, "png", cut),
        )
    ]
    path = write_mcap(tmp_path / "a.mcap", [*good[:3], *bad, *good[3:]])
    assert main(["import", str(path), "--out", str(tmp_path / "b.mcap")]) == 3
    error = capsys.readouterr().err
    assert "messages that can't be read: 2" in error
    assert "pictures that can't be decoded: 1" in error
    assert len(list(open_input_file(tmp_path / "b.mcap").messages())) == 1


def test_a_change_of_size_ends_the_stream_and_is_said(tmp_path):
    small = [("/cam", *m, t) for m, t in messages_of("ros png", 3)]
    payload = ros_compressed(STAMP_NS, "png", still(np.zeros((9, 9), np.uint8), ".png"))
    big = ("/cam", "cdr", COMPRESSED, payload, STAMP_NS)
    source, frames = frames_of(write_mcap(tmp_path / "a.mcap", [*small, big]))
    assert len(frames) == 3
    assert source.loss == "the pictures change their size to 9×9"


@pytest.mark.parametrize(
    ("encoding", "pixel"),
    [
        ("mono8", [90]), ("8UC1", [90]), ("yuyv", [90, 128]), ("yuv422_yuy2", [90, 128]),
        ("yuv422", [128, 90]), ("uyvy", [128, 90]), ("rgb8", [90] * 3), ("bgr8", [90] * 3),
        ("8UC3", [90] * 3), ("rgba8", [90] * 3 + [255]), ("bgra8", [90] * 3 + [255]),
        ("mono16", [0, 90]),
    ],
)  # fmt: skip
def test_pixels_of_every_form_and_padded_lines(encoding, pixel):
    line = bytes(pixel) * 6 + bytes(5)
    raw = RawPicture(0, encoding, 6, 4, len(line), False, line * 4)
    luma = raw_luma(raw)
    assert luma.shape == (4, 6)
    assert np.all(luma == 90)


def test_colours_are_weighted_and_not_mixed_up():
    red = raw_luma(RawPicture(0, "rgb8", 4, 2, 0, False, bytes([200, 0, 0]) * 8))
    also = raw_luma(RawPicture(0, "bgr8", 4, 2, 0, False, bytes([0, 0, 200]) * 8))
    assert np.array_equal(red, also)
    assert red[0, 0] == pytest.approx(0.299 * 200, abs=2)


@pytest.mark.parametrize("height", [1, 2, 3, 9, 24])
@pytest.mark.parametrize("width", [1, 2, 3, 9, 32])
def test_mosaics_of_any_size(height, width):
    """Even where FFmpeg by itself would abort the process."""
    grey = np.full((height, width), 90, np.uint8)
    luma = raw_luma(RawPicture(0, "bayer_gbrg8", width, height, 0, False, grey.tobytes()))
    assert luma.shape == (height, width)
    assert np.abs(luma.astype(int) - 90).max() <= 1


def test_deep_samples_in_either_order():
    for big_endian, data in ((True, b"\x5a\x00"), (False, b"\x00\x5a")):
        luma = raw_luma(RawPicture(0, "mono16", 4, 2, 0, big_endian, data * 8))
        assert np.all(luma == 0x5A)


def test_a_file_without_pictures_says_what_is_in_it(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", [("/odom", "cdr", "nav_msgs/msg/Odometry", b"", 5)])
    assert main(["import", str(path), "--out", str(tmp_path / "b.mcap")]) == 1
    with pytest.raises(InputError, match="holds no row blocks"):
        open_input_file(path)
    assert not (tmp_path / "b.mcap").exists()


def test_nothing_is_overwritten_unasked(tmp_path, capsys):
    path = ros_wall(tmp_path / "a.mcap", 3)
    content = path.read_bytes()
    assert main(["import", str(path), "--out", str(path)]) == 2
    assert main(["import", str(path), "--out", str(path), "--overwrite"]) == 2
    assert "is the file to read" in capsys.readouterr().err
    assert path.read_bytes() == content


def test_files_of_the_ros_library_itself(tmp_path):
    writer = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support isn't installed")
    definition = (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
        "uint8 is_bigendian\nuint32 step\nuint8[] data\n"
        f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    )
    with open(tmp_path / "a.mcap", "wb") as stream, writer.Writer(stream) as out:
        schema = out.register_msgdef(IMAGE, definition)
        for stamp_ns, luma in wall_luma(5):
            seconds, nanos = divmod(stamp_ns, SECOND_NS)
            out.write_message("/cam", schema, {
                "header": {"stamp": {"sec": seconds, "nanosec": nanos}, "frame_id": "c"},
                "height": luma.shape[0], "width": luma.shape[1], "encoding": "mono8",
                "is_bigendian": 0, "step": luma.shape[1], "data": luma.tobytes(),
            }, log_time=stamp_ns)  # fmt: skip
    _, frames = frames_of(tmp_path / "a.mcap")
    for (stamp_ns, luma), frame in zip(wall_luma(5), frames, strict=True):
        assert np.array_equal(frame.luma, luma)
        assert frame.header.camera_time_ns == stamp_ns
