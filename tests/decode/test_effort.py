"""Decoding with less effort, on a device, and the change of effort while a feed goes on."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event
from typing import Any

import av
import numpy as np
import pytest
import rtsp_server
from av.video.codeccontext import VideoCodecContext
from decode_clips import frames_of, make_clip, only_frames, pictures, source_of
from rtsp_server import RtspServer

from rsenf.decode import SourceSpec, open_source
from rsenf.decode import decoder as decoder_module
from rsenf.decode.rtsp import EffortControl
from rsenf.decode.source import Stamp
from rsenf.decode.stream import StreamDecoder
from rsenf.messages import Frame
from rsenf.regress import regress
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows
from rsenf.run.inline import analyse
from rsenf.run.inputs import open_input_file

COUNT = 60
# Coded as coarsely as to need the loop filter; key frames that frames before them are built on.
COARSE = {
    "libx264": {"qp": "38", "x264-params": "keyint=12:scenecut=0:open-gop=1:bframes=3:b-adapt=0"},
    "libx265": {"x265-params": "qp=38:keyint=12:scenecut=0:open-gop=1:bframes=3:log-level=none"},
    "mjpeg": {"qmin": "20", "qmax": "20"},
}


@pytest.fixture(scope="module", params=COARSE)
def film(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("effort") / f"{request.param}.mkv"
    lumas = pictures(COUNT, 96, 128)
    return make_clip(path, lumas, request.param, options=COARSE[request.param])


def has_filter(film: Path) -> bool:
    return film.stem != "mjpeg"


def lumas(frames: Sequence[Frame]) -> list[np.ndarray[Any, Any]]:
    return [np.asarray(frame.luma) for frame in frames]


def times(frames: Sequence[Frame]) -> list[tuple[int, int]]:
    return [(frame.header.frame_first, frame.header.pts_ns) for frame in frames]


def test_fast_leaves_out_the_loop_filter_and_says_so(film: Path) -> None:
    full, fast = frames_of(film), frames_of(film, effort="fast")
    assert times(fast) == times(full)
    assert {frame.effort for frame in full} == {""}
    assert {frame.effort for frame in fast} == ({"fast"} if has_filter(film) else {""})
    same = [np.array_equal(a, b) for a, b in zip(lumas(full), lumas(fast), strict=True)]
    assert all(same) != has_filter(film)


def decoded(
    film: Path,
    switches: dict[int, str] | None = None,
    threads: int = 1,
    on_device: Callable[[str, str], VideoCodecContext | None] | None = None,
    **spec: Any,
) -> tuple[list[Frame], StreamDecoder]:
    """Decode a film packet by packet, and ask for another effort before some packets."""
    asked = SourceSpec(url=str(film), kind="file", threads=threads, **spec)
    more: dict[str, Any] = {"on_device": on_device} if on_device else {}
    frames: list[Frame] = []
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        stamp = Stamp("lab/cam", "test", time.time_ns)
        decoder = StreamDecoder(container, stream, asked, stamp, **more)
        for number, packet in enumerate(container.demux(stream)):
            if effort := (switches or {}).get(number):
                decoder.decoder.ask_for(effort)  # type: ignore[arg-type]
            frames += only_frames(decoder.feed(packet, 0))
    return frames, decoder


@pytest.mark.parametrize("threads", [1, 0])
def test_no_picture_is_lost_where_the_effort_changes(film: Path, threads: int) -> None:
    full = frames_of(film)
    found, decoder = decoded(film, {15: "fast", 40: "full"}, threads)
    assert times(found) == times(full)
    assert not decoder.damaged_packets
    if not has_filter(film):
        assert {frame.effort for frame in found} == {""}
        return
    changes = [n for n in range(1, COUNT) if found[n].effort != found[n - 1].effort]
    assert len(changes) == 2
    first, second = changes
    assert 12 < first <= 30
    assert 36 < second <= 55
    key = [n for n, frame in enumerate(full) if frame.keyframe]
    assert {first, second} <= set(key)
    for n, (one, other) in enumerate(zip(lumas(full), lumas(found), strict=True)):
        if n < first or n >= second:
            assert np.array_equal(one, other), n


def test_what_the_leaving_decoder_loses_is_all_that_is_lost(
    film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decode = decoder_module._Leaving.decode

    def breaks(self: Any, packet: Any) -> Any:
        if packet is None or packet.pts >= self.key_pts + 4 * packet.duration:
            raise av.InvalidDataError(1, "no")
        return decode(self, packet)

    monkeypatch.setattr(decoder_module._Leaving, "decode", breaks)
    full = frames_of(film)
    found, decoder = decoded(film, {15: "fast"})
    assert decoder.damaged_packets == has_filter(film)
    first = next((frame for frame in found if frame.effort), None)
    if first:
        kept = [frame.header.pts_ns for frame in found if frame.effort]
        after = [f.header.pts_ns for f in full if f.header.pts_ns >= first.header.pts_ns]
        assert first.keyframe
        assert kept == after


def without_vui(data: bytes) -> bytes:
    """Return H.264 (Annex B, main profile) whose parameter sets don't say how it is reordered."""

    def stripped(found: re.Match[bytes]) -> bytes:
        bits = "".join(f"{byte:08b}" for byte in found[2].replace(b"\0\0\3", b"\0\0"))
        at = 24  # after profile and level

        def number() -> int:
            nonlocal at
            zeros = bits.index("1", at) - at
            at += 2 * zeros + 1
            return int(bits[at - zeros - 1 : at], 2) - 1

        number(), number()  # its own, and that of frames
        if number() == 0:  # how pictures are ordered
            number()
        number()  # reference frames
        at += 1
        number(), number()  # macroblocks across and down
        at += 3  # of progressive pictures that aren't cropped
        assert bits[at - 3 : at : 2] + bits[at] == "101"
        kept = bits[:at] + "01"
        kept += "0" * (-len(kept) % 8)
        return found[1] + bytes(int(kept[n : n + 8], 2) for n in range(0, len(kept), 8))

    sets = b"(\x00\x00\x01[\x27\x47\x67])(.*?)(?=\x00\x00\x00?\x01|$)"
    return re.sub(sets, stripped, data, flags=re.DOTALL)


def test_the_next_decoder_knows_how_pictures_are_reordered(tmp_path: Path) -> None:
    coded = make_clip(
        tmp_path / "coded.ts", pictures(COUNT, 96, 128),
        options={"profile": "main", "qp": "38", "x264-params": "keyint=12:bframes=3:b-adapt=0"},
    )  # fmt: skip
    with av.open(str(coded)) as read, av.open(str(tmp_path / "undeclared.ts"), "w") as written:
        stream = read.streams.video[0]
        out = written.add_stream_from_template(stream)
        for packet in read.demux(stream):
            if packet.size:
                bare: Any = av.Packet(without_vui(bytes(packet)))
                assert bare.size < packet.size or not packet.is_keyframe
                bare.pts, bare.dts, bare.time_base = packet.pts, packet.dts, packet.time_base
                bare.is_keyframe, bare.stream = packet.is_keyframe, out
                written.mux(bare)
    film = tmp_path / "undeclared.ts"
    found, decoder = decoded(film, {15: "fast", 40: "full"})
    assert times(found) == times(frames_of(film))
    assert len(found) == COUNT
    assert {frame.effort for frame in found} == {"", "fast"}
    assert not decoder.damaged_packets


def test_a_device_that_is_not_there_is_one_line_and_no_loss(film: Path) -> None:
    with source_of(film, hwaccel="cuda") as source:
        frames = only_frames(source)
        assert [w for w in source.warnings if "hwaccel cuda: no such device" in w]
    assert times(frames) == times(frames_of(film))


def test_a_device_decodes_where_there_is_one(film: Path) -> None:
    asked: list[tuple[str, str]] = []

    def device(kind: str, codec: str) -> VideoCodecContext:
        asked.append((kind, codec))
        made = VideoCodecContext.create(codec, "r")
        assert isinstance(made, VideoCodecContext)
        return made

    found, decoder = decoded(film, hwaccel="vaapi", effort="fast", on_device=device)
    assert [kind for kind, _ in asked] == ["vaapi"]
    assert not decoder.decoder.without_device
    full = frames_of(film)
    assert times(found) == times(full)
    assert {frame.effort for frame in found} == {""}  # a device leaves nothing out
    assert all(np.array_equal(a, b) for a, b in zip(lumas(found), lumas(full), strict=True))


class Refuses:
    """A device that turns out not to decode the stream, at once or after some packets."""

    def __init__(self, takes: int) -> None:
        self.takes = takes

    def decode(self, packet: Any) -> list[av.VideoFrame]:
        self.takes -= 1
        if self.takes < 0:
            raise av.InvalidDataError(1, "no")
        return []


@pytest.mark.parametrize("takes", [0, 5, COUNT])
@pytest.mark.parametrize("effort", ["full", "fast"])
def test_a_device_that_cannot_decode_the_stream_falls_back(
    film: Path, takes: int, effort: str
) -> None:
    refuses: Any = Refuses(takes)
    found, decoder = decoded(
        film, hwaccel="auto", effort=effort, on_device=lambda kind, codec: refuses
    )
    assert times(found) == times(frames_of(film))
    assert decoder.decoder.without_device
    assert not decoder.damaged_packets
    fast = effort == "fast" and has_filter(film)
    assert {frame.effort for frame in found} == {"fast" if fast else ""}


def test_a_block_of_rows_says_how_its_frames_were_decoded(film: Path) -> None:
    found, _ = decoded(film, {15: "fast"})
    stage = Rows(RowsSettings(block_frames=8, mask=False))
    blocks = [block for frame in found for block in stage.update(frame)] + stage.flush()
    first = next((n for n, frame in enumerate(found) if frame.effort), COUNT)
    assert (first < COUNT) == has_filter(film)
    for block in blocks:
        assert block.effort == ("fast" if block.header.frame_last >= first else "")


def test_a_result_says_how_it_was_decoded(film: Path) -> None:
    for effort in ("full", "auto", "fast"):
        found = analyse(open_input_file(film, effort=effort), rows=RowsSettings())
        said = [w for w in found.warnings if "without the codec's loop filter" in w]
        assert len(said) == (effort == "fast" and has_filter(film)), effort
        if said:
            assert said[0].startswith(f"{COUNT} of {COUNT} frames")


@pytest.mark.processes
def test_a_recording_keeps_it_and_is_not_judged_by_another_decoding(
    film: Path, rsenf: Callable[..., Any], tmp_path: Path
) -> None:
    out = tmp_path / "out.mcap"
    graph = tmp_path / "graph.yaml"
    graph.write_text(
        "version: 1\nsite: lab\nnodes:\n"
        f'  decode: {{kind: decode, camera: a, input: "{film}", frames: fused, effort: fast}}\n'
        f'  record: {{kind: record, out: "{out}"}}\n'
    )
    done = rsenf("run", graph, "--quiet")
    assert done.returncode == 0, done.stderr
    found = analyse(open_input_file(out), rows=RowsSettings())
    assert found.fast_frames == (COUNT if has_filter(film) else 0)
    (rows,) = regress(out).topics
    assert ("without the loop filter" in rows.unjudged) == has_filter(film)
    assert has_filter(film) or rows.passed


def test_the_effort_follows_the_backlog_with_hysteresis() -> None:
    control = EffortControl()
    now_s = 0.0

    def after(seconds: float, waiting: int) -> str:
        nonlocal now_s
        now_s += seconds
        return control.update(waiting, now_s)

    assert after(1, 0) == "full"
    assert after(1, EffortControl.BEHIND - 1) == "full"
    assert after(1, EffortControl.BEHIND) == "fast"
    assert after(100, EffortControl.BEHIND - 1) == "fast"  # it isn't caught up with
    assert after(1, 0) == "fast"
    assert after(EffortControl.AIR_S - 1, 0) == "fast"
    assert after(2, 0) == "full"
    assert after(1, EffortControl.BEHIND) == "fast"
    assert after(1, 0) == "fast"
    assert after(EffortControl.AIR_S + 1, 0) == "fast"  # longer the second time
    assert after(EffortControl.AIR_S + 1, 0) == "full"


@pytest.mark.external
def test_a_feed_that_is_too_fast_is_decoded_with_less_before_a_frame_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if lacking := rtsp_server.missing():
        pytest.skip(lacking)
    monkeypatch.setattr(EffortControl, "AIR_S", 1.0)
    said: list[str] = []
    stop = Event()
    with RtspServer("h264") as server:
        source = open_source(
            SourceSpec(url=server.url, kind="rtsp", open_timeout_s=120.0, threads=1),
            source="lab/cam",
            run_id="r",
            clock_ns=time.time_ns,
            stop=stop,
            on_event=said.append,
        )
        efforts: list[str] = []
        with source:
            for frame in only_frames_of(source):
                efforts.append(frame.effort)
                if not any("effort fast" in line for line in said):
                    time.sleep(0.07)  # it takes longer than a frame lasts
                elif any("effort full" in line for line in said):
                    break
        assert source.loss == ""
    assert efforts[0] == ""
    assert "fast" in efforts
    assert [line.rpartition("effort ")[2] for line in said] == ["fast", "full"]


def only_frames_of(source: Any) -> Any:
    return (item for item in source if isinstance(item, Frame))
