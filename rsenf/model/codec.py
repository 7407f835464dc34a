"""Encoder settings: codec, quality or bit rate, preset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rsenf.model import parameters
from rsenf.model.parameters import ParameterError, parameter

ENCODERS = {"h264": "libx264", "h265": "libx265", "vp9": "libvpx-vp9", "mjpeg": "mjpeg"}
_PRESETS = ("ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower")


@dataclass(frozen=True, kw_only=True)
class Codec:
    """An encoder and its settings."""

    name: str = parameter("h264", "codec", choices=tuple(ENCODERS))
    bitrate_bps: int | None = parameter(
        None, "mean bit rate; None is constant quality", low=1000, high=1_000_000_000
    )
    crf: int = parameter(18, "constant quality, when no bit rate is given", low=0, high=51)
    lossless: bool = parameter(False, "what is decoded is what was rendered, bit for bit")
    preset: str | None = parameter(
        None,
        "x264's and x265's effort; None is 'superfast' at a bit rate, else 'ultrafast'",
        choices=_PRESETS,
    )
    weighted_prediction: bool | None = parameter(
        None, "whether h264 and h265 follow changes of brightness by a factor; None is the preset's"
    )
    gop_frames: int = parameter(250, "most frames from one key frame to the next", low=1, high=3000)

    def validate(self) -> None:
        """Check combinations of parameters.

        Raises
        ------
        ParameterError
            For a bit rate together with lossless, lossless MJPEG, and weighted prediction where the
            codec has none.
        """
        if self.lossless and self.bitrate_bps is not None:
            raise ParameterError(("codec", "lossless"), "excludes codec.bitrate_bps")
        if self.lossless and self.name == "mjpeg":
            raise ParameterError(
                ("codec", "lossless"), "can't be had from mjpeg", "use h264, h265 or vp9"
            )
        if self.weighted_prediction is not None and self.name not in ("h264", "h265"):
            raise ParameterError(("codec", "weighted_prediction"), f"isn't known to {self.name}")

    def to_dict(self) -> dict[str, Any]:
        """Return its parameters as plain values."""
        return parameters.to_dict(self)

    def options(self) -> dict[str, str]:
        """Private options of the encoder, as FFmpeg names them."""
        preset = self.preset or ("superfast" if self.bitrate_bps else "ultrafast")
        asked = {None: -1, False: 0, True: 1}[self.weighted_prediction]
        if self.name == "h264":
            weights = ({"weightp": "none"}, {"weightp": "smart"}, {})[asked]
            return {"preset": preset, **weights, **self._quality({"qp": "0"})}
        if self.name == "h265":
            # x265 would write its log to stderr.
            params = "log-level=none" + (":weightp=0", ":weightp=1", "")[asked]
            params += ":lossless=1" if self.lossless else ""
            return {"preset": preset, "x265-params": params, **self._quality({})}
        if self.name == "vp9":
            return {"deadline": "realtime", "cpu-used": "8", **self._quality({"lossless": "1"})}
        return {} if self.bitrate_bps else {"qmin": "3", "qmax": "3"}

    def _quality(self, lossless: dict[str, str]) -> dict[str, str]:
        if self.lossless:
            return lossless
        return {} if self.bitrate_bps else {"crf": str(self.crf)}
