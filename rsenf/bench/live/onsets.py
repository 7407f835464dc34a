"""When a rule began to say that something is wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

# Alarms nearer to the one before than this are the same one to whoever is called by them.
SAME_S = 60.0


def onsets(said: Iterable[tuple[float, bool]]) -> list[float]:
    """Return the times at which a rule that was silent began to alarm.

    Parameters
    ----------
    said : iterable of (float, bool)
        Times, in order, and whether it alarms from then on.
    """
    out, before = [], False
    for t_s, alarming in said:
        if alarming and not before:
            out.append(t_s)
        before = alarming
    return out


def told_apart(times_s: Sequence[float]) -> list[float]:
    """Return the alarms without those that follow another within :data:`SAME_S`."""
    out: list[float] = []
    last_s = -SAME_S
    for t_s in times_s:
        if t_s - last_s >= SAME_S:
            out.append(t_s)
        last_s = t_s
    return out


def false_and_delay(times_s: Sequence[float], attack_s: float | None) -> tuple[int, float | None]:
    """Count alarms before an attack, and tell how long after its first picture the first one came.

    Parameters
    ----------
    times_s : sequence of float
        Of the alarms.
    attack_s : float or None
        When the first false picture was taken; None where there is none.
    """
    if attack_s is None:
        return len(told_apart(times_s)), None
    after = [t for t in times_s if t >= attack_s]
    before = [t for t in times_s if t < attack_s]
    return len(told_apart(before)), after[0] - attack_s if after else None
