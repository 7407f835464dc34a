"""Effects that FFmpeg makes of a clean clip, by filters and encoders: none of them is rsenf's own.

``python -m tests.discrepancy.by_ffmpeg SEED [NAME ...]`` runs `rsenf discover` on each, and prints
what it found beside what it should have.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import yaml

from rsenf.model import CaptureModel, Light, Shutter, render_frames, synthetic_grid
from rsenf.model.video_file import Codec, write_video

SECONDS, WIDTH_PX, LINES, IDLE = 30.0, 128, 160, 0.38
NTSC, WHOLE = Fraction(30000, 1001), Fraction(30)
LOSSLESS = "-c:v libx264 -preset ultrafast -qp 0"
NOTHING, NAMED, UNKNOWN, REFUSED = "no_discrepancy", "explained", "unexplained", "refused"


@dataclass(frozen=True)
class Case:
    """What FFmpeg is told, and what should be found.

    Attributes
    ----------
    words : str
        Between the clean clip and what is made of it.
    verdict : str
        Where an effect is named rightly, the rest may be left unexplained: rounding is no effect.
    names : tuple of str
        Effects of which one must be named, alone or in a class, and no other.
    parameters : dict
    idle_ratio : float
    rate : Fraction
        Of the clean clip.
    """

    words: str
    verdict: str = NOTHING
    names: tuple[str, ...] = ()
    parameters: dict[str, Any] = field(default_factory=dict)
    idle_ratio: float = IDLE
    rate: Fraction = NTSC


def _filter(chain: str, *args: Any, **more: Any) -> Case:
    return Case(f'-vf "{chain}" {LOSSLESS}', *args, **more)


def _coded(how: str, **more: Any) -> Case:
    return Case(f"-c:v libx264 -preset superfast {how}", **more)


_DROPPED = "select='not(eq(n,200)+eq(n,600))'"
_FINE = "settb=1/90000"
_STAMPED = f"-fps_mode passthrough -enc_time_base 1/90000 -video_track_timescale 90000 {LOSSLESS}"
CASES = {
    # Fitted parameters change, or nothing does.
    "as it is": Case("-c copy"),
    "hflip": _filter("hflip"),
    "hue": _filter("hue=h=60:s=0.5"),
    "noise": _filter("noise=alls=12:allf=t"),
    "crop rows": _filter("crop=iw:ih-32:0:16", idle_ratio=1 - (1 - IDLE) * (LINES - 32) / LINES),
    "crop columns": _filter("crop=iw-32:ih:16:0"),
    "scale down": _filter("scale=96:120"),
    "scale up": _filter("scale=256:320"),
    "transposed": _filter("transpose=0"),
    "half the rate": _filter("framestep=2", idle_ratio=(1 + IDLE) / 2),
    "clock 1.001": Case(f'-vf "{_FINE},setpts=PTS*1.001" {_STAMPED}'),
    "hole in stamps": Case(f'-vf "{_DROPPED}" -fps_mode passthrough {LOSSLESS}'),
    # Of the catalogue.
    "vflip": _filter("vflip", NAMED, ("reverse_readout",)),
    "turned clockwise": _filter("transpose=1", NAMED, ("reverse_readout",)),
    "drop": _filter(
        f"{_DROPPED},setpts=N/(30000/1001)/TB", NAMED, ("frame_drop",), {"at_frames": [200, 600]}
    ),
    "duplicate": _filter(
        "setpts=(N+gte(N\\,300))/(30000/1001)/TB,fps=30000/1001",
        NAMED, ("frame_duplicate",), {"at_frames": [299]},
    ),
    "copies hide the next": _filter(
        f"{_DROPPED},fps=30000/1001", NAMED, ("frame_duplicate",), {"at_frames": [199, 599]}
    ),
    "fps 29.97 to 30": _filter("fps=30", NAMED, ("frame_duplicate",)),
    "fps 30 to 29.97": _filter("fps=30000/1001", NAMED, ("frame_drop",), rate=WHOLE),
    "fields woven": _filter("field=top,weave", NAMED, ("interlace",)),
    "interlace": _filter("interlace=lowpass=0", NAMED, ("interlace",)),
    "interlace, lines averaged": _filter("interlace", NAMED, ("interlace",)),
    "gamma 1.3": _filter("eq=gamma=1.3", NAMED, ("gamma",)),
    "gamma 0.8": _filter("eq=gamma=0.8", NAMED, ("gamma",)),
    "gamma 0.4": _filter("eq=gamma=0.4", NAMED, ("gamma",)),
    "gamma 2.5": _filter("eq=gamma=2.5", NAMED, ("gamma",)),
    "stamps in error": Case(
        f'-vf "{_FINE},setpts=PTS+0.002*(random(0)-0.5)/TB" {_STAMPED}',
        NAMED, ("timestamp_jitter",),
    ),
    # Of no catalogue.
    "stamps that wander": Case(f'-vf "{_FINE},setpts=PTS+0.002*sin(T)/TB" {_STAMPED}', UNKNOWN),
    "curves": _filter(
        "curves=all='0/0 0.3/0.2 0.7/0.8 1/1'", UNKNOWN, ("gamma", "harmonics")
    ),
    "vibrance": _filter("vibrance=intensity=0.5", UNKNOWN),
    # A gain of all the picture; what is black then is dithered, as no gain is.
    "fade in": _filter("fade=t=in:st=0:d=5", UNKNOWN, ("auto_exposure",)),
    "fade out": _filter("fade=t=out:st=22:d=6", UNKNOWN, ("auto_exposure",)),
    "fps 30 to 25": _filter("fps=25", UNKNOWN, rate=WHOLE),
    "fps 29.97 to 25": _filter("fps=25", UNKNOWN),
    # Encoders by themselves.
    "100k": _coded("-b:v 100k -x264-params weightp=0"),
    "100k weighted": _coded("-b:v 100k -x264-params weightp=2"),
    "50k": _coded("-b:v 50k -x264-params weightp=0"),
    "50k weighted": _coded("-b:v 50k -x264-params weightp=2"),
    "20k": _coded("-b:v 20k -x264-params weightp=0"),
    "20k weighted": _coded("-b:v 20k -x264-params weightp=2"),
    "gop 12": _coded("-b:v 100k -g 12"),
    "gop 48": _coded("-b:v 50k -g 48"),
    "medium, b-frames": Case("-c:v libx264 -crf 28 -g 250"),
    "mpeg4": Case("-c:v mpeg4 -b:v 200k -g 30"),
    "vp9": Case("-c:v libvpx-vp9 -b:v 60k -deadline realtime -cpu-used 8"),
}  # fmt: skip


def film(path: Path, seed: int, rate: Fraction = NTSC, seconds: float = SECONDS) -> Path:
    """Film a wall under a pure tone, losslessly."""
    shutter = Shutter(frame_rate=rate, rows=LINES, columns=WIDTH_PX, idle_ratio=IDLE)
    model = CaptureModel(light=Light(lamp="tone"), shutter=shutter)
    frames = render_frames(model, synthetic_grid(seed, seconds + 1.0), seconds, seed)
    write_video(path, frames, Codec(lossless=True))
    return path


def made(clean: Path, out: Path, case: Case) -> Path:
    """Have FFmpeg make a case of a clean clip."""
    words = ["ffmpeg", "-v", "error", "-y", "-i", clean, *shlex.split(case.words), out]
    subprocess.run([str(word) for word in words], check=True)
    return out


def discovered(clip: Path, folder: Path) -> dict[str, Any]:
    """Run the command on it; a refusal has its line as ``reason``."""
    words = [sys.executable, "-m", "rsenf.cli", "discover", clip, "--out", folder, "--json"]
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    if done.returncode:
        return {"verdict": REFUSED, "effects": [], "reason": done.stderr.splitlines()[-1]}
    told: dict[str, Any] = json.loads(done.stdout)
    model = yaml.safe_load((folder / "model.yaml").read_text())
    return told | {"idle_ratio": model["shutter"]["idle_ratio"]}


def names_of(told: dict[str, Any]) -> list[list[str]]:
    """Return the class of each effect that was found; one that is sure is alone in it."""
    return [effect["class"] or [effect["name"]] for effect in told["effects"]]


def grade(case: Case, told: dict[str, Any]) -> str:
    """Judge what was found: ``right``, or in what it isn't."""
    found = names_of(told)
    if told["verdict"] == REFUSED:
        return REFUSED
    if any(not set(names) & set(case.names) for names in found):
        return "named wrongly"
    if case.names and not found:
        return "not named" if told["verdict"] == UNKNOWN else "missed"
    parameters = told["effects"][0]["parameters"] if found else {}
    if any(parameters.get(name) != value for name, value in case.parameters.items()):
        return "other parameters"
    if told["verdict"] == case.verdict:
        return "right"
    return "right, in part" if found else f"not {case.verdict}"


def main(seed: int, names: Sequence[str]) -> None:
    print(f"{'case':26s} {'grade':16s} {'verdict':15s} gap before -> after, limit; idle; effects")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        clean = {rate: film(folder / f"{float(rate)}.mp4", seed, rate) for rate in (NTSC, WHOLE)}
        for name in names or CASES:
            case = CASES[name]
            clip = made(clean[case.rate], folder / f"{name}.mp4", case)
            told = discovered(clip, folder / name)
            print(f"{name:26s} {grade(case, told):16s} {_line(case, told)}", flush=True)


def _line(case: Case, told: dict[str, Any]) -> str:
    if told["verdict"] == REFUSED:
        return told["reason"]  # type: ignore[no-any-return]
    gap = told["gap"]
    size = f"{gap['before']:8.2g} -> {gap['after']:8.2g}, {gap['limit']:8.2g}"
    gone = "" if gap["shrinkage"] is None else f"; {100 * gap['shrinkage']:.1f} % gone"
    idle = f"idle {told['idle_ratio']:.4f} of {case.idle_ratio:.4f}"
    effects = "".join(f"; {'/'.join(names)}" for names in names_of(told))
    return f"{told['verdict']:15s} {size}{gone}; {idle}{effects}"


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
