"""Errata of the paper's line model and tables, and the table entries that each of them changes.

The reason for a wrong entry is found, not listed: each printed entry is compared with the model as
the paper reads it, then with the exact ``M``, then with all lines. Where two successive readings
differ, the change between them is the reason.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from rsenf.model.analytic import RECTIFIED
from rsenf.model.analytic_tables import (
    AS_PUBLISHED,
    PUBLISHED_TABLES,
    Entry,
    PublishedTable,
    Reading,
    idle_table,
    printed_table,
)

_TABLES = "both idle tables"


@dataclass(frozen=True)
class Difference:
    """A printed entry and the correct one."""

    frame_rate_hz: float
    nominal_hz: float
    published: Entry
    right: Entry  # unrounded


@dataclass(frozen=True)
class Erratum:
    """An error of the paper, with the entries of the idle tables that it changes."""

    name: str
    where: str  # in the paper
    published: str
    right: str
    entries: tuple[Difference, ...] = ()


def errata() -> tuple[Erratum, ...]:
    """List the known errors of the paper's line model and tables."""
    found: dict[str, list[Difference]] = {}
    for table in PUBLISHED_TABLES:
        for name, difference in _differences(table):
            found.setdefault(name, []).append(difference)
    return tuple(
        dataclasses.replace(erratum, entries=tuple(found.get(erratum.name, ())))
        for erratum in _ERRATA
    )


def _differences(table: PublishedTable) -> Iterator[tuple[str, Difference]]:
    """Yield the errata that a table's entries show, with the correct entry."""
    place = (table.frame_rate_hz, table.nominal_hz)
    all_lines = "coinciding_lines" if _divides(*place) else "folded_lines"
    as_published, exact, full = (
        printed_table(*place, reading)
        for reading in (AS_PUBLISHED, Reading(folded=False), Reading())
    )
    right, rectified = (
        idle_table(*place, reading) for reading in (Reading(), Reading(harmonics=RECTIFIED))
    )
    for n, printed in enumerate(table.entries):
        defined = printed
        if printed.amplitude_ratio is None:
            defined = dataclasses.replace(printed, h2_hz=())
            yield "undefined_second_line", Difference(*place, printed, right[n])
        steps = (defined, as_published[n], exact[n], full[n])
        for name, before, after in zip(
            ("printed_digit", "whole_rows", all_lines), steps[:-1], steps[1:], strict=True
        ):
            if not before.agrees(after):
                yield name, Difference(*place, printed, right[n])
        if _lines(rectified[n].h2_hz) != _lines(right[n].h2_hz):
            yield "second_harmonic", Difference(*place, printed, rectified[n])


def _divides(frame_rate_hz: float, nominal_hz: float) -> bool:
    """Whether lines of the light coincide: ``2·f_0`` is a multiple of ``F_r``."""
    turns = 4 * nominal_hz / frame_rate_hz
    return abs(turns - round(turns)) < 1e-9


def _lines(freq_hz: tuple[float, ...]) -> set[float]:
    return {round(hz, 3) for hz in freq_hz}


_ERRATA = (
    Erratum(
        "amplitude_not_power",
        f"{_TABLES}, P_H1/P_H2",
        "a ratio of powers",
        "It is the ratio of amplitudes: at 29.97 fps and 5 % idle (1 − c)/c = 5.0 with "
        "c = f_0·ρ/F_r; the powers' ratio would be 24.9.",
    ),
    Erratum(
        "undefined_second_line",
        f"{_TABLES}, wherever the ratio is infinite",
        "a second line of 0, 75 or 100 Hz",
        "c is whole there, so harmonic 1 makes one line only: there is no second one.",
    ),
    Erratum(
        "printed_digit",
        "idle table, 29.97 fps, 35 % and 55 %",
        "5.0 and 5.0",
        "The paper's own model, with M = round(L/(1 − ρ)) and L = 720, gives 4.9 and 5.1. With the "
        "exact M it gives 4.96 and 5.07: the print is right at 35 % and 0.1 low at 55 %.",
    ),
    Erratum(
        "whole_rows",
        "idle table, 29.97 fps, 30 % and 35 %",
        "505.6 at 30 %",
        "998, against the 40 Hz line: 505.6 is an artefact of rounding M to whole rows, for which "
        "nothing in a camera asks. Near a zero of the second line small shifts of ρ or F_r count: "
        "with F_r = 30000/1001 in place of 29.97 the exact ratio is 999.",
    ),
    Erratum(
        "folded_lines",
        "Eq. 20 (Eq_S2), m < f_0/F_r; idle table, 29.97 fps, 90 % and 95 %",
        "H_2 at 40 Hz, ratios 334.0 and 6.9",
        "Lines below 0 Hz are seen at |f_0 − m·F_r|. The second line is at 19.9 Hz, its ratio 332 "
        "at 90 % and 4.9 at 95 %.",
    ),
    Erratum(
        "coinciding_lines",
        "idle table and model at 25 fps; every frame rate that divides 2·f_0, as 30 fps at 60 Hz",
        "one ratio for each idle period",
        "The lines f_0 − m·F_r and −(f_0 − (8 − m)·F_r) are at the same frequency and add as "
        "complex numbers, and the line of m = 4 is lost in the steady light. The ratio depends on "
        "the light's phase: 3.5 to 4.6 at 20 % (printed 4.0), 2.1 to 4.1 at 95 % (printed 2.2). "
        "The table gives the ratio of root mean squares over all phases, and the range.",
    ),
    Erratum(
        "second_harmonic",
        "the text before the section on idle-period estimation; both idle tables",
        "the two strongest lines always come from harmonic 1",
        "Not for |cos| light, the paper's own, where c is nearly whole: H_2 then belongs to "
        "harmonic 2, which is a fifth of harmonic 1, so that the ratio is 5.0.",
    ),
    Erratum(
        "attenuation",
        "Eq. 7 (Fm), the figures of the model, abstract and conclusion",
        "the longer the idle period, the weaker the captured line",
        "F_m carries 1/M, but Eq. 6 also squeezes the frequency axis by L/M, which raises a line "
        "by M/L. In the row series the strongest line has the amplitude |sinc(c − m)|: between "
        "0.64 and 1 at any idle period, unless it is lost at 0 Hz.",
    ),
    Erratum(
        "vertical_phase",
        "Eq. 24, the idle period from the vertical phase (second use of the label Eq_read_out)",
        "100 − (f_I/F_r)·(100/N_c)",
        "100·(1 − N_c·F_r/f_I): a frame period holds f_I/F_r cycles, and N_c of them fall in the "
        "read-out. The printed formula is negative for every idle period above 0.",
    ),
    Erratum(
        "exposure",
        "the whole model",
        "not considered",
        "An exposure T_e multiplies harmonic k by sinc(k·f_0·T_e). It cancels out of ratios within "
        "harmonic 1; 1/200 s (at 100 Hz) removes harmonic 2, 1/100 s removes everything.",
    ),
)
