"""Films: even cells wherever a run is stopped, cameras that stay themselves."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from rsenf.bench.recording_time import CAMERAS, KINDS, LAMPS, ROUND, RecordingPlan
from rsenf.bench.recording_time.trials import _setting_of
from rsenf.bench.scenes import CLOCK_PPM
from rsenf.errors import UsageError
from rsenf.model.effects.shutter import ClockSkew

FILMS = RecordingPlan(clips=2 * ROUND, first_seed=30).films()


def clock_ppm(number: int) -> float:
    effects = _setting_of(FILMS[number]).model.effects
    return next(e.clock_ppm for e in effects if isinstance(e, ClockSkew))


def test_a_round_has_every_camera_under_every_lamp_still_and_moving() -> None:
    found = {(f.kind, f.camera, f.lamp) for f in FILMS[:ROUND]}
    assert len(found) == ROUND == len(list(product(KINDS, range(CAMERAS), LAMPS)))
    assert len({f.camera for f in FILMS[:ROUND]}) == CAMERAS


def test_wherever_it_is_stopped_kinds_are_even() -> None:
    for made in range(2, len(FILMS), 2):
        kinds = [f.kind for f in FILMS[:made]]
        assert kinds.count("still") == kinds.count("moving")


def test_a_still_film_and_the_next_have_camera_and_lamp_in_common() -> None:
    for still, moving in zip(FILMS[::2], FILMS[1::2], strict=True):
        assert (still.camera, still.lamp) == (moving.camera, moving.lamp)
        a, b = _setting_of(still).model, _setting_of(moving).model
        assert a.shutter == b.shutter
        assert a.scene.mean_level != b.scene.mean_level


def test_another_round_has_other_cameras() -> None:
    first, second = ({f.camera for f in part} for part in (FILMS[:ROUND], FILMS[ROUND:]))
    assert not first & second
    assert clock_ppm(0) != clock_ppm(ROUND)


def test_only_moving_films_move() -> None:
    for film in FILMS:
        model = _setting_of(film).model
        model.validate()
        moves = model.scene.shake is not None, "moving_object" in {e.name for e in model.effects}
        assert moves == ((film.kind == "moving"),) * 2


def test_clocks_are_those_of_cameras() -> None:
    films = RecordingPlan(clips=400 * ROUND).films()[:: ROUND // 2]
    drawn = [
        CLOCK_PPM * float(_after_idle(f.camera_generator()).standard_t(4))
        for f in films
    ]  # fmt: skip
    # Three quarters of a Student t with four degrees of freedom lie within 1.34 of its scale.
    assert np.mean(np.abs(drawn) < 1.344 * CLOCK_PPM) == pytest.approx(0.75, abs=0.06)


def _after_idle(rng: np.random.Generator) -> np.random.Generator:
    rng.uniform()
    return rng


def test_every_film_has_a_name_of_its_own() -> None:
    others = RecordingPlan(clips=ROUND, first_seed=30, codings=("lossless",)).films()
    assert len({f.key for f in [*FILMS, *others]}) == len(FILMS) + len(others)
    assert not any("/" in f.key for f in FILMS)


@pytest.mark.parametrize(
    "wrong", [{"size": "1p"}, {"codings": ("10",)}, {"duration_s": 600.0, "reference_s": 1000.0}]
)
def test_a_recording_plan_that_cannot_be_meant_so(wrong: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        RecordingPlan(**wrong)  # type: ignore[arg-type]  # any one of them
