"""Who was excluded: when the liars were, and whether they stayed so; who did not lie; who came back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from .epoch import Epoch, Spell
from .watch import Said

# whether a unit is a wheel that slips at a scenario time
Slips = Callable[[str, float], bool]
MOST_REASONS = 5
# a unit is back when it has been in use for so long
IN_USE_S = 1.0
# of times in seconds: sums and differences of floats end in noise
DIGITS = 6


def grips(unit: str, t_s: float) -> bool:  # noqa: ARG001
    """No wheel slips."""
    return False


def detection(epochs: Sequence[Epoch], spells: Sequence[Spell], said: Sequence[Said]) -> dict[str, Any]:
    """When all liars were excluded, doubted and named by a warning: the largest of the times since their onsets.

    And whether they stayed excluded.
    """
    times = [_since(spell, (e.t_s for e in epochs if spell.unit in e.excluded)) for spell in spells]
    warned = [_since(spell, (s.at_s for s in said if s.unit == spell.unit or spell.unit in s.text.split())) for spell in spells]
    doubted = [_since(spell, (e.t_s for e in epochs if spell.unit in e.state.doubted)) for spell in spells]
    found = {"time_to_detect_s": _largest(times), "time_to_doubt_s": _largest(doubted), "time_to_warn_s": _largest(warned)}
    return found | _used_again(epochs, spells)


def _used_again(epochs: Sequence[Epoch], spells: Sequence[Spell]) -> dict[str, int]:
    """The epochs from a liar's first exclusion to the end of its fault, and in how many of these it is not excluded."""
    found = used = 0
    for spell in spells:
        lies = [spell.unit in e.excluded for e in epochs if spell.from_s <= e.t_s < spell.to_s]
        since = lies[lies.index(True) :] if True in lies else []
        found, used = found + len(since), used + since.count(False)
    return {"found_epochs": found, "used_again_epochs": used}


def acting(spell: Spell, telegrams: Sequence[tuple[float, str]]) -> Spell:
    """A reader's fault acts from its next telegram on; any other from its onset on."""
    return spell._replace(
        from_s=next((at_s for at_s, unit in telegrams if unit == spell.unit and at_s >= spell.from_s), spell.from_s)
    )


def _since(spell: Spell, moments: Iterable[float]) -> float | None:
    """The time from the onset to the first moment at or after it; None where there is none."""
    return next((round(at_s - spell.from_s, DIGITS) for at_s in moments if at_s >= spell.from_s), None)


def _largest(times: Sequence[float | None]) -> float | None:
    found = [time for time in times if time is not None]
    return max(found) if found and len(found) == len(times) else None


def excused(epochs: Sequence[Epoch], slips: Slips) -> set[tuple[float, str]]:
    """The epochs of exclusions that began while the wheel slipped: it was not the train's speed that it told."""
    out: set[tuple[float, str]] = set()
    previous: dict[str, bool] = {}
    for epoch in epochs:
        previous = {unit: previous[unit] if unit in previous else slips(unit, epoch.t_s) for unit in epoch.excluded}
        out |= {(epoch.t_s, unit) for unit, slipped in previous.items() if slipped}
    return out


def innocents(epochs: Sequence[Epoch], units: Sequence[str], slipped: set[tuple[float, str]]) -> dict[str, Any]:
    """Exclusions of units without a fault that are heard: epochs, how often one began, and which units with which reasons."""
    counted: dict[str, dict[str, Any]] = {}
    previous: set[str] = set()
    begun = 0
    for epoch in epochs:
        state = epoch.state
        heard = [(unit, reason) for unit, reason in state.excluded if unit in units and unit not in state.unheard]
        now = {unit: reason for unit, reason in heard if (epoch.t_s, unit) not in slipped}
        begun += len(now.keys() - previous)
        previous = set(now)
        for unit, reason in now.items():
            entry = counted.setdefault(unit, {"epochs": 0, "reasons": []})
            entry["epochs"] += 1
            if reason not in entry["reasons"] and len(entry["reasons"]) < MOST_REASONS:
                entry["reasons"].append(reason)
    return {
        "innocent_epochs": len(epochs) * len(units),
        "wrongly_excluded_epochs": sum(entry["epochs"] for entry in counted.values()),
        "wrong_exclusions": begun,
        "wrongly_excluded": dict(sorted(counted.items())),
    }


def recovery(epochs: Sequence[Epoch], ended: Sequence[Spell]) -> dict[str, Any]:
    """Whether the liars that were excluded during their faults came back, and how long after its fault the last one did."""
    times = [
        _back(epochs, spell)
        for spell in ended
        if any(spell.unit in e.excluded for e in epochs if spell.from_s <= e.t_s < spell.to_s)
    ]
    return {"readmitted": None not in times if times else None, "time_to_recover_s": _largest(times)}


def _back(epochs: Sequence[Epoch], spell: Spell) -> float | None:
    """The time from the end of a fault until its unit is in use for a second; None where it is not until the run ends."""
    since_s: float | None = None
    for epoch in epochs:
        if epoch.t_s < spell.to_s or spell.unit in epoch.excluded:
            since_s = None
        elif since_s is None:
            since_s = epoch.t_s
        elif epoch.t_s - since_s >= IN_USE_S:
            return round(since_s - spell.to_s, DIGITS)
    return None
