"""Messages in, JSON out: what a page is told, and that it stays small."""

from __future__ import annotations

import base64
import dataclasses
import gc
import json
import tracemalloc
from fractions import Fraction

import cv2
import messages_of
import numpy as np
import pytest
from messages_of import RATE_HZ, START_NS, Camera, S, grid_hz, health, reference

from rsenf.dashboard.alarm_board import KEPT_ALARMS
from rsenf.dashboard.app import SILENCE_NS, Session
from rsenf.dashboard.enf_series import GridReference
from rsenf.dashboard.site import KEPT_FEEDS, NodeBoard, Site, Wiring
from rsenf.dashboard.spectrogram import BINS, HALF_WIDTH_HZ
from rsenf.messages import EnfEstimate, Header, RowBlock, VideoPacket
from rsenf.run.roster import Seen

DOOR = "house/door"


class Shown:
    """A site with a clock of its own, and a browser that looks at one feed."""

    def __init__(
        self, wiring: Wiring | None = None, feed: str = DOOR, series: str = "recent"
    ) -> None:
        self.now_ns = START_NS
        self.site = Site(wiring or Wiring(), lambda: self.now_ns)
        self.session = Session(self.site)
        self.session.ask(json.dumps({"feed": feed, "series": series}))

    def put(self, *sent) -> None:
        for key, message in sent:
            header = message.header
            self.now_ns = max(self.now_ns, header.arrival_time_ns)
            self.site.update(key, message)

    def news(self) -> dict:
        self.now_ns += S
        text = self.session.news()
        return json.loads(text) if text else {}


def pictured(news: dict) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(news["data"]), np.uint8)
    return data.reshape(news["columns"], news["height"])


def test_a_card_has_verdict_enf_idle_and_match():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(*camera.seconds(0, 30))
    shown.put(camera.live(30, "stale", since=10, lag_s=200.2, evidence="fits 200.2 s ago"))
    (card,) = shown.news()["cards"]
    assert card["name"] == DOOR
    assert card["live"]["verdict"] == "stale"
    assert card["live"]["since_ms"] == START_NS // 1_000_000 + 10_000
    assert card["live"]["lag_s"] == 200.2
    assert card["enf_hz"] == pytest.approx(grid_hz(60)[29], abs=0.003)
    assert (card["idle"]["low"], card["idle"]["high"]) == (0.3794, 0.3806)
    assert card["match"]["log10_lr"] == 6.2
    assert card["streams"] == 1


def test_what_is_unknown_is_null_and_what_is_unusable_has_a_reason():
    shown, camera = Shown(), Camera("door", grid_hz(9))
    key, message = camera.enf(0, usable=False)
    shown.put((key, dataclasses.replace(message, enf_hz=float("nan"), snr_db=float("inf"))))
    (card,) = shown.news()["cards"]
    assert card["enf_hz"] is None
    assert card["snr_db"] is None
    assert card["enf_reason"] == "no mains flicker stands out"
    assert card["live"] is None


@pytest.mark.parametrize("judged", [frozenset({DOOR}), frozenset(), None])
def test_it_says_whether_anybody_judges_a_feed(judged):
    shown = Shown(Wiring({DOOR: ["door"]}, judged))
    expected = None if judged is None else DOOR in judged
    assert shown.news()["cards"][0]["is_judged"] is expected


def test_the_chart_has_gaps_where_nothing_is_usable():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    for second in range(40):
        if not 20 <= second < 25:  # lost on the way
            shown.put(camera.enf(second, usable=second >= 5))
    chart = shown.news()["chart"]
    assert chart["enf_hz"][:5] == [None] * 5
    assert None not in chart["enf_hz"][5:20]
    assert chart["enf_hz"][20] is None
    assert len(chart["t_ms"]) == 36
    assert np.all(np.diff(chart["t_ms"]) > 0)


def test_the_reference_lies_under_it_by_the_clock_else_by_the_match():
    freq_hz = grid_hz(400)
    camera = Camera("door", freq_hz[100:])
    by_clock, by_match = Shown(), Shown()
    by_clock.put(reference(freq_hz, START_NS - 100 * S))
    by_match.put(reference(freq_hz, START_NS - 10**6 * S))  # long ago
    for shown in (by_clock, by_match):
        shown.put(*(camera.enf(second) for second in range(30)))
    by_match.put(camera.match(0, lag_s=100.0))
    for shown, how in ((by_clock, "clock"), (by_match, "match")):
        chart = shown.news()["chart"]
        assert chart["placed"] == {"grid": "ce", "how": how}
        assert chart["reference_hz"] == pytest.approx(freq_hz[100:130], abs=1e-5)


def test_a_file_lies_on_the_reference_of_when_it_is_said_to_be():
    freq_hz, said_ns = grid_hz(400), START_NS - 10**6 * S
    shown = Shown(Wiring({DOOR: []}, claimed_ns={DOOR: said_ns + 50 * S}))
    camera = Camera("door", freq_hz[50:])
    shown.put(reference(freq_hz, said_ns), *(camera.enf(second) for second in range(30)))
    key, live = camera.live(30, "stale")
    shown.put((key, dataclasses.replace(live, since_ns=said_ns + 60 * S)))
    news = shown.news()
    assert news["chart"]["placed"] == {"grid": "ce", "how": "claim"}
    assert news["chart"]["reference_hz"] == pytest.approx(freq_hz[50:80], abs=1e-5)
    assert news["cards"][0]["live"]["since_ms"] == START_NS // 1_000_000 + 10_000


def test_without_a_time_in_common_no_reference_is_drawn():
    shown, camera = Shown(), Camera("door", grid_hz(30))
    shown.put(reference(grid_hz(99), START_NS - 10**6 * S), camera.enf(0), camera.enf(1))
    chart = shown.news()["chart"]
    assert chart["placed"] is None
    assert chart["reference_hz"] == [None, None]


def test_the_spectrogram_shows_the_flicker_where_the_grid_is():
    freq_hz = np.full(90, 50.06)
    shown, camera = Shown(), Camera("door", freq_hz)
    shown.put(camera.idle(0), camera.enf(0), *(camera.rows(second) for second in range(60)))
    columns = pictured(shown.news()["spectrogram"])
    axis_hz = 50 + np.linspace(HALF_WIDTH_HZ, -HALF_WIDTH_HZ, BINS)
    bright = axis_hz[columns[-20:].argmax(axis=1)]
    assert bright == pytest.approx(50.06, abs=0.02)
    dark = np.abs(axis_hz - 50.06) > 0.12
    assert columns[-20:][:, dark].mean() < 60 < 200 < columns[-20:].max(axis=1).min()


def test_the_strip_shows_bands_and_lost_frames():
    shown, camera = Shown(), Camera("door", grid_hz(30))
    shown.put(*(camera.rows(second) for second in range(5)))
    shown.put(camera.rows(6))  # a second later: its frames are there, the second's between aren't
    strip = shown.news()["strip"]
    columns = pictured(strip).astype(float)
    assert strip["rms_level"] > 0.5
    lost = (columns == 0).all(axis=1)
    assert lost.sum() == 0  # the camera counts on, so nothing is missing
    spectrum = np.abs(np.fft.rfft(columns - columns.mean(axis=1, keepdims=True), axis=1))
    bands = 2 * 50 * (1 - messages_of.IDLE) / RATE_HZ  # down the frame
    assert spectrum.mean(axis=0).argmax() == pytest.approx(bands, abs=0.6)
    key, block = camera.rows(7)
    shown.put((key, dataclasses.replace(block, frame_number=block.frame_number + 7)))
    assert (pictured(shown.news()["strip"]) == 0).all(axis=1).sum() == 7


def test_only_what_is_new_is_told_and_all_of_it_to_who_comes_late():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(*camera.seconds(0, 20))
    assert shown.news()["strip"]["reset"]
    shown.put(*camera.seconds(20, 21))
    news = shown.news()
    assert news["strip"]["columns"] in (29, 30, 31)
    assert not news["strip"]["reset"]
    assert news["spectrogram"]["columns"] == 1
    late = Session(shown.site)
    late.ask(json.dumps({"feed": DOOR}))
    told = json.loads(late.news())
    assert told["strip"]["columns"] == 240
    assert len(told["chart"]["t_ms"]) == 21
    assert told["site"]["feeds"] == [DOOR]


def test_silence_is_broken_now_and_then_so_that_a_page_knows_the_link_stands():
    shown = Shown()
    assert shown.news()
    assert shown.session.news() == ""
    shown.now_ns += SILENCE_NS
    assert set(json.loads(shown.session.news())) == {"version", "now_ms"}


@pytest.mark.parametrize("text", ["", "{", "[]", "7", '{"feed": {}}', "[" * 5000, '{"series": 1}'])
def test_a_question_that_is_none_changes_nothing(text):
    shown = Shown()
    shown.session.ask(text)
    assert "site" in shown.news()


def test_a_source_that_starts_again_is_marked():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(*camera.seconds(0, 10))
    again = Camera("door", grid_hz(60), START_NS + 20 * S, run_id="b")
    shown.put(*again.seconds(0, 5))
    again.epoch = 1
    shown.put(again.enf(6))
    (card,) = shown.news()["cards"]
    assert card["streams"] == 3
    assert card["began_ms"][1] - card["began_ms"][0] == 20_000


def test_stages_that_speak_of_different_streams_begin_none_anew():
    shown = Shown()
    before, again = (Camera("door", grid_hz(60), run_id=run) for run in ("a", "a.rows1"))
    for second in range(5):
        shown.put(before.enf(second), again.rows(second))
    assert shown.news()["cards"][0]["streams"] == 2


def test_nodes_that_say_nothing_are_silent_and_restarts_are_told():
    shown = Shown(Wiring({DOOR: ["door", "track"]}))
    shown.put(health("door", "decode", START_NS), health("track", "track", START_NS))
    shown.put(health("door", "decode", START_NS + S, seq=1, restarts=1))
    shown.put(health("track", "track", START_NS + 9 * S, seq=1, state="done"))
    shown.now_ns = START_NS + 90 * S
    news = shown.news()
    assert news["cards"][0]["nodes"] == {"door": "silent", "track": "done"}
    assert {n["name"]: n["restarts"] for n in news["nodes"]["list"]} == {"door": 1, "track": 0}


def test_a_node_is_silent_when_rsenf_nodes_says_so():
    _, word = health("door", "decode", START_NS)
    board, seen = NodeBoard(), Seen("house", "door", alive=True, health=word)
    board.update(word, START_NS)
    ages_s = np.arange(0, 6, 0.25)
    states = [board.state("door", START_NS + round(age_s * S)) for age_s in ages_s]
    assert states == [seen.state(age_s) for age_s in ages_s]
    assert set(states) == {"running", "silent"}


def test_a_node_of_a_host_whose_clock_is_wrong_is_heard_all_the_same():
    shown = Shown(Wiring({DOOR: ["door"]}))
    key, word = health("door", "decode", START_NS - 3600 * S)
    shown.put((key, word))
    news = shown.news()
    assert news["cards"][0]["nodes"] == {"door": "running"}
    assert news["nodes"]["list"][0]["heard_ms"] == START_NS // 1_000_000


def test_a_reference_keeps_the_newest_samples_and_what_was_said_last(monkeypatch):
    monkeypatch.setattr("rsenf.dashboard.enf_series.KEPT_SAMPLES", 500)
    grid = GridReference()
    _, block = reference(np.array([50.0]))
    for number in range(550):
        freq_hz = np.array([49.9 + 1e-6 * number])
        grid.add(dataclasses.replace(block, first=number, freq_hz=freq_hz))
        if number % 100 == 0:
            assert np.isfinite(grid.at(np.array([number * S])))
    grid.add(dataclasses.replace(block, first=549, freq_hz=np.array([50.2])))  # mended
    found = grid.at(np.array([49, 50, 549, 550]) * S)
    np.testing.assert_allclose(found, [np.nan, 49.90005, 50.2, np.nan], atol=1e-5)


def test_an_alarm_comes_once_and_ends():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(camera.alarm(0, 7), camera.alarm(1, 7), camera.alarm(2, 9, kind="loop"))
    news = shown.news()
    assert [a["kind"] for a in news["alarms"]["list"]] == ["loop", "phase_jump"]
    assert news["cards"][0]["alarms"] == 2
    assert news["alarms"]["list"][1]["start_ms"] == START_NS // 1_000_000 + 7000
    shown.put(camera.alarm(3, 7, active=False))
    assert [a["active"] for a in shown.news()["alarms"]["list"]] == [True, False]


def test_an_alarm_whose_judge_died_ends_when_the_feed_is_live():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(camera.live(20, "live"))
    shown.put(camera.alarm(0, 20, kind="stale"), camera.alarm(1, 20, kind="phase_jump"))
    shown.put(camera.live(19, "live"))  # on its way when the alarm came
    assert [a["active"] for a in shown.news()["alarms"]["list"]] == [True, True]
    shown.put(camera.live(40, "live"))
    assert [a["active"] for a in shown.news()["alarms"]["list"]] == [True, False]


def test_an_alarm_that_holds_stays_whatever_comes_after_it():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(camera.alarm(0, 7, kind="stale"))
    for number in range(1, 300):
        shown.put(camera.alarm(number, 7 + number))
    told = shown.news()
    assert len(told["alarms"]["list"]) == KEPT_ALARMS
    assert told["alarms"]["list"][-1]["kind"] == "stale"
    assert told["cards"][0]["alarms"] == 2


def test_an_alarm_ends_with_its_stream_or_when_it_comes_again():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(camera.alarm(0, 7, kind="stale"), camera.alarm(1, 7, kind="lost"))
    camera.epoch = 1  # the camera came back, and its clock begins anew
    shown.put(camera.alarm(2, 1, kind="stale", active=False), camera.alarm(3, 4, kind="lost"))
    alarms = shown.news()["alarms"]["list"]
    assert [(a["kind"], a["active"]) for a in alarms] == [
        ("lost", True), ("lost", False), ("stale", False),
    ]  # fmt: skip
    assert alarms[2]["start_ms"] == START_NS // 1_000_000 + 7000
    assert alarms[2]["end_ms"] >= alarms[2]["start_ms"]


def test_no_secret_is_told():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    secret = "rtsp://admin:hunter2@10.0.0.7/cam password=hunter2"
    shown.put(
        health("door", "decode", START_NS, detail=secret),
        camera.alarm(0, 1, text=secret),
        camera.live(0, evidence=secret),
        camera.enf(0),
    )
    assert "hunter2" not in json.dumps(shown.news())


def test_messages_without_sense_cost_nothing():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    header = Header(source=DOOR, run_id="a", pts_ns=-(1 << 62), arrival_time_ns=1)
    shown.put(
        (camera.key("rows"), RowBlock(header=header)),
        (camera.key("rows"), RowBlock(header=header, frames=3, rows=0)),
        (camera.key("track"), EnfEstimate(header=header, enf_hz=float("inf"), usable=True)),
        (camera.key("frames"), VideoPacket(header=header, codec="h264", keyframe=True,
                                                       data=b"rubbish")),
    )  # fmt: skip
    assert shown.news()["cards"]


def test_the_picture_is_renewed_once_a_second():
    shown, camera = Shown(), Camera("door", grid_hz(60))
    shown.put(camera.key_frame(0), camera.key_frame(0), camera.key_frame(0))
    assert shown.news()["cards"][0]["picture"] == 1
    assert shown.site.picture(DOOR).startswith(b"\xff\xd8")
    shown.put(camera.key_frame(3))
    assert shown.news()["cards"][0]["picture"] == 2


def test_a_key_frame_of_real_video_is_decoded_and_what_follows_it_is_let_be():
    import av

    coder = av.CodecContext.create("libx264", "w")
    coder.width, coder.height, coder.pix_fmt, coder.time_base = 640, 360, "yuv420p", Fraction(1, 30)
    coder.options = {"tune": "zerolatency"}
    picture = av.VideoFrame.from_ndarray(np.full((540, 640), 128, np.uint8), format="yuv420p")
    packets = [*coder.encode(picture), *coder.encode(picture)]
    shown, camera = Shown(), Camera("door", grid_hz(60))
    for number, packet in enumerate(packets):
        header = camera.header(number, 2.0 * number)
        sent = VideoPacket(
            header=header, codec="h264", keyframe=packet.is_keyframe, data=bytes(packet)
        )
        shown.put((camera.key("video"), sent))
    assert [p.is_keyframe for p in packets] == [True, False]
    assert shown.news()["cards"][0]["picture"] == 1
    jpeg = np.frombuffer(shown.site.picture(DOOR), np.uint8)
    assert cv2.imdecode(jpeg, cv2.IMREAD_COLOR).shape == (180, 320, 3)


def test_after_an_hour_memory_grows_no_more():
    shown, seconds = Shown(series="hour"), 5400
    camera = Camera("door", grid_hz(seconds))
    rows = [camera.rows(second) for second in range(3)][-1]
    sizes = []
    tracemalloc.start()
    for second in range(0, seconds, 2):
        shown.put(camera.enf(second))
        if second % 10 == 0:  # more alarms than are kept, and than Python has small numbers for
            shown.put(camera.alarm(second, second), health("n", "k", START_NS))
            key, block = rows  # by memory a block is like another
            fresh = dataclasses.replace(
                block,
                header=camera.header(second, second),
                frame_number=block.frame_number + 30 * second,
                frame_pts_ns=block.frame_pts_ns + second * S,
            )
            shown.put((key, fresh))
        if second % 100 == 0:
            shown.session.news()
        if second in (4100, seconds - 2):
            gc.collect()
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    # Of the 650 estimates since, not even 32 bytes each, the least that any object takes, are kept;
    # the table of a dict that is laid out anew takes 9 kB, at its own time.
    assert sizes[1] < sizes[0] + 20_000 < 1_000_000
    late = Session(shown.site)
    late.ask(json.dumps({"feed": DOOR, "series": "hour"}))
    told = json.loads(late.news())
    assert 350 <= len(told["chart"]["t_ms"]) <= 360
    assert len(told["alarms"]["list"]) == 200
    assert len(json.dumps(told)) < 400_000


def test_more_feeds_than_can_be_shown_are_left_out_and_that_is_said():
    shown = Shown()
    for number in range(KEPT_FEEDS + 3):
        shown.put(Camera(f"cam{number}", grid_hz(3)).enf(0))
    news = shown.news()
    assert len(news["cards"]) == KEPT_FEEDS
    assert news["site"]["left_out"] is True
