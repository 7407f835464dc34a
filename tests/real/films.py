"""What is claimed of films without mains light, and found in the same scenes under a weak lamp.

``python -m tests.real.films FIRST LAST --out FILE.jsonl`` films the scenes of
:mod:`tests.real.scenes` with these seeds, dark and lit, and appends a line for each film and pair
of methods; what has its line already is left out. ``--summary PICTURE.png`` only tells what the
file holds: by method, false claims with their 95 % bound, shares found, errors over stated ones.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.api.recordings import read_recording
from rsenf.rows.settings import AUTO, RowsSettings
from tests.flicker.claims import Claims, at_most, claims
from tests.real.scenes import Lamp, draw_scene, film

PAIRS = ("projection+coherent", "stft+vertical_phase", "phase+line_ratio",
         "row_concat+line_ratio_bins", "superpixel+", "frame_mean+", "paper+")  # fmt: skip
WRONG_Z, WRONG_HZ, WRONG_IDLE = 5.0, 0.01, 0.01
Line = dict[str, Any]


def lines_of(seed: int, lit: bool, pairs: Sequence[str]) -> list[Line]:
    """Film a scene and let methods look at it: a line for each pair of them."""
    scene = draw_scene(seed, lit=lit)
    told: Line = {"seed": seed, "lit": lit, "kind": scene.kind, "rate": scene.rate}
    told |= {"coding": scene.coding, "noise": scene.noise, "seconds": round(scene.seconds, 2)}
    if scene.lamp:
        told["flicker_ratio"] = scene.lamp.flicker_ratio
        told["nominal_hz"] = scene.lamp.grid.nominal_hz
        told["idle_ratio"] = scene.lamp.idle_ratio
    with tempfile.TemporaryDirectory() as folder:
        film(scene, path := Path(folder) / "film.mp4")
        rows = RowsSettings(read_out_axis=AUTO, tile_means=any("superpixel" in p for p in pairs))
        held = read_recording(path, rows=rows)
    level = held.rows
    if level.size:
        told["moves_ratio"] = float(np.sqrt(level.var(axis=0).mean()) / max(level.mean(), 1.0))
    out = []
    for pair in pairs:
        track, idle = pair.split("+")
        found = claims(held, None, track, idle or "coherent")
        line = told | {"pair": pair, track: _enf(found, scene.lamp)}
        out.append(line | ({idle: _idle(found, scene.lamp)} if idle else {}))
    return out


def _enf(found: Claims, lamp: Lamp | None) -> Line:
    """What is said of the ENF, and how far off that is."""
    usable = found.usable
    told: Line = {"seconds": len(found.track), "usable": len(usable)}
    if not usable:
        return told | {"reason": found.track[0].reason if found.track else "too short"}
    hz = np.array([e.enf_hz for e in usable])
    std_hz = np.sqrt([max(e.enf_var_hz2, 1e-18) for e in usable])
    told |= {"enf_hz": float(hz.mean()), "enf_std_hz": float(std_hz.mean())}
    if lamp:
        turns, at_s = lamp.grid.turns, np.array([e.t_s for e in usable])
        off_hz = hz - (turns(at_s + 0.5) - turns(at_s - 0.5))
        told |= {"rms_hz": _rms(off_hz), "rms_z": _rms(off_hz / std_hz)}
    return told


def _idle(found: Claims, lamp: Lamp | None) -> Line:
    """What is said of the idle period, and how far off that is."""
    told: Line = {"verdict": found.idle.verdict, "reason": found.idle.reason}
    if found.idle.verdict == "estimated":
        std = max(found.idle.idle_ratio_std, 1e-9)
        told |= {"idle_ratio": found.idle.idle_ratio, "idle_ratio_std": std}
        if lamp:
            off = found.idle.idle_ratio - lamp.idle_ratio
            told |= {"off": off, "z": off / std}
    return told


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def is_claimed(said: Line) -> bool:
    """Whether something is claimed."""
    return bool(said.get("usable") or said.get("verdict") == "estimated")


def is_wrong(said: Line) -> bool:
    """Whether a claim is surely wrong: off by much, and by many of its standard errors."""
    if "rms_hz" in said:
        return bool(said["rms_z"] > WRONG_Z and said["rms_hz"] > WRONG_HZ)
    return bool(abs(said.get("z", 0.0)) > WRONG_Z and abs(said["off"]) > WRONG_IDLE)


def by_method(lines: Iterable[Line]) -> dict[str, list[tuple[Line, Line]]]:
    """All that each method said, with what of."""
    out: dict[str, list[tuple[Line, Line]]] = {}
    for line in lines:
        for method in filter(None, line["pair"].split("+")):
            out.setdefault(method, []).append((line, line[method]))
    return out


def summary(lines: Sequence[Line]) -> None:
    """Print what is claimed by each method."""
    for method, said in by_method(lines).items():
        dark = [s for s in said if not s[0]["lit"]]
        lit = [s for s in said if s[0]["lit"]]
        false = [line for line, told in dark if is_claimed(told)]
        right = [told for _, told in lit if is_claimed(told)]
        wrong = [line for line, told in lit if is_claimed(told) and is_wrong(told)]
        bound = 100 * at_most(len(false), len(dark))
        z = [abs(told.get("rms_z", told.get("z", math.nan))) for told in right]
        print(
            f"{method:15s} dark: {len(false)} false in {len(dark)} (95 % bound {bound:.2f} %); "
            f"lit: {len(right)} found of {len(lit)}, z {np.median(z) if z else math.nan:.2f}, "
            f"over 3 in {sum(x > 3 for x in z)}, surely wrong {len(wrong)}"
        )
        for what, some in (("false", false), ("wrong", wrong)):
            for line in some:
                about = {k: v for k, v in line[method].items() if k != "seconds"}
                place = f"{line['kind']} {line['seed']} {line['rate']} {line['coding']}"
                print(f"    {what} {place} {line.get('flicker_ratio', 0):.2g} {about}")


def picture(lines: Sequence[Line], path: Path) -> None:
    """Draw the share found over the flicker's strength, and of false claims over the motion's."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for axis, lit, strength in ((axes[0], True, "flicker_ratio"), (axes[1], False, "moves_ratio")):
        for method, said in by_method(lines).items():
            own = [s for s in said if s[0]["lit"] == lit and s[0].get(strength)]
            at = np.array([line[strength] for line, _ in own])
            claimed = np.array([is_claimed(told) for _, told in own])
            edges = np.geomspace(2e-4, 3e-2, 8) if lit else np.geomspace(1e-4, 1.0, 9)
            shares = [
                100 * claimed[inside].mean() if (inside := (at >= a) & (at < b)).any() else np.nan
                for a, b in itertools.pairwise(edges)
            ]
            axis.semilogx(100 * np.sqrt(edges[1:] * edges[:-1]), shares, "o-", label=method)
        axis.set_ylabel("found, % of films" if lit else "false claims, % of films")
        axis.set_ylim(-2, 102 if lit else None)
    axes[0].set_xlabel("flicker, amplitude in % of the light")
    axes[1].set_xlabel("change of the rows, rms in % of the level")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.real.films", description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int, help="seeds end before this one")
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines")
    parser.add_argument("--pairs", nargs="+", default=PAIRS[:1], choices=(*PAIRS, "all"))
    parser.add_argument("--only", choices=("dark", "lit"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--summary", type=Path, help="picture; nothing is filmed")
    asked = parser.parse_args()
    pairs = PAIRS if "all" in asked.pairs else asked.pairs
    held = asked.out.read_text().splitlines() if asked.out.exists() else []
    lines = [json.loads(line) for line in held]
    if asked.summary:
        lines = [line for line in lines if asked.first <= line["seed"] < asked.last]
        summary(lines)
        picture(lines, asked.summary)
        return
    done = {(line["seed"], line["lit"], line["pair"]) for line in lines}
    with ProcessPoolExecutor(asked.jobs) as pool, asked.out.open("a") as out:
        running = [
            pool.submit(lines_of, seed, lit, left)
            for seed in range(asked.first, asked.last)
            for lit in (False, True)
            if asked.only != ("dark" if lit else "lit")
            if (left := [pair for pair in pairs if (seed, lit, pair) not in done])
        ]
        for each in as_completed(running):
            for line in each.result():
                out.write(json.dumps(line) + "\n")
            out.flush()


if __name__ == "__main__":
    main()
