"""The figures of one run: interval, errors, exclusions, from live states and the truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from milepost.checks.published import Array, Flags
from milepost.checks.requirements import subset_041_position

from .watch import Said, Seen, Watch

# whether a unit is a wheel that slips at a scenario time
Slips = Callable[[str, float], bool]
MOST_REASONS = 5
# a unit is back when it has been in use for so long
IN_USE_S = 1.0
# of times in seconds: sums and differences of floats end in noise
DIGITS = 6


class Spell(NamedTuple):
    """The fault of a unit: from when to when, in scenario time; `to_s` is infinite where it does not end.

    `acts`: whether there was anything for it to act on; a reader that passes no balise cannot lie.
    """

    unit: str
    from_s: float
    to_s: float
    acts: bool = True


class Epoch(NamedTuple):
    """A live state beside the true position and speed."""

    t_s: float
    state: Seen
    position_m: float
    speed_mps: float

    @property
    def outside_position(self) -> bool:
        """Whether the true position is outside the interval."""
        return not self.state.position_min_m <= self.position_m <= self.state.position_max_m

    @property
    def outside_speed(self) -> bool:
        """Whether the true speed is outside the interval."""
        return not self.state.speed_min_mps <= self.speed_mps <= self.state.speed_max_mps

    @property
    def outside(self) -> bool:
        """Whether either is outside."""
        return self.outside_position or self.outside_speed

    @property
    def excluded(self) -> set[str]:
        """The units that are excluded."""
        return {unit for unit, _ in self.state.excluded}


def grips(unit: str, t_s: float) -> bool:  # noqa: ARG001
    """No wheel slips."""
    return False


def measure(
    watch: Watch, spells: Sequence[Spell], onset_s: float, units: Sequence[str], slips: Slips = grips
) -> dict[str, Any]:
    """All figures of a run; those of an epoch count from the first onset on (`onset_s` where there is no fault).

    `slips`: whether a unit is a wheel that slips at a scenario time.
    """
    onset_s = min((spell.from_s for spell in spells), default=onset_s)
    end_s = max((spell.to_s for spell in spells), default=math.inf)
    epochs = [Epoch(t, watch.states[t], *truth) for t, truth in sorted(watch.truth.items()) if t in watch.states]
    before, after = [e for e in epochs if e.t_s < onset_s], [e for e in epochs if e.t_s >= onset_s]
    due = sum(t >= onset_s for t in watch.truth)
    figures: dict[str, Any] = {
        "liars": sum(spell.acts for spell in spells),
        "never_acted": sum(not spell.acts for spell in spells),
        "observed_s": _span_s(after),
        "epochs": len(after),
        "epochs_without_state": due - len(after),
        "outside_before_onset_epochs": sum(e.outside for e in before),
    }
    figures |= _interval(after)
    figures |= _errors([e for e in after if e.t_s < end_s], "during") | _errors([e for e in after if e.t_s >= end_s], "after")
    figures |= _detection(after, [_acting(spell, watch.telegrams) for spell in spells if spell.acts], watch.said)
    excused = _excused(epochs, slips)
    figures |= _innocents(after, sorted(set(units) - {spell.unit for spell in spells}), excused)
    figures |= _recovery(after, [spell for spell in spells if not math.isinf(spell.to_s)])
    resets = [e.state.reset_m for e in after if e.state.reset_m is not None]
    figures |= {"resets": len(resets), "reset_max_m": max(resets, default=None)}
    figures["events"] = dict(sorted(Counter(f"{s.unit}: {s.code}" for s in watch.said if s.at_s >= onset_s).items()))
    return figures


def _span_s(epochs: Sequence[Epoch]) -> float:
    if len(epochs) < 2:
        return 0.0
    # the last epoch lasts as long as one lasts on average
    return (epochs[-1].t_s - epochs[0].t_s) * len(epochs) / (len(epochs) - 1)


def _interval(epochs: Sequence[Epoch]) -> dict[str, Any]:
    position = np.array([(e.state.position_max_m - e.state.position_min_m) / 2.0 for e in epochs])
    speed = np.array([(e.state.speed_max_mps - e.state.speed_min_mps) / 2.0 for e in epochs])
    return {
        "outside_epochs": sum(e.outside for e in epochs),
        "outside_position_epochs": sum(e.outside_position for e in epochs),
        "outside_speed_epochs": sum(e.outside_speed for e in epochs),
        "normal_while_outside_epochs": sum(e.outside and e.state.status == "normal" for e in epochs),
        "first_outside_s": next((e.t_s for e in epochs if e.outside), None),
        "position_half_width_median_m": _median(position),
        "position_half_width_max_m": float(position.max()) if len(position) else None,
        "speed_half_width_median_mps": _median(speed),
        "speed_half_width_max_mps": float(speed.max()) if len(speed) else None,
        **_subset_041(epochs),
        "statuses_epochs": dict(sorted(Counter(e.state.status for e in epochs).items())),
    }


def _median(values: Any) -> float | None:
    return float(np.median(values)) if len(values) else None


@dataclass(frozen=True)
class _Columns:
    """The epochs of a run as the checks look at them."""

    states: Array
    truth: Array
    bounds: Array
    since_balise_m: Array
    location_accuracy_m: Array
    lost: Flags
    accuracy: Array | None = None
    steps_m: Array | None = None
    stamps_s: Array | None = None


def _subset_041(epochs: Sequence[Epoch]) -> dict[str, int]:
    """How many epochs the check of SUBSET-041's position applies to, and in how many of these the interval is permitted."""
    seen = [e.state for e in epochs]
    columns = _Columns(
        np.array([(s.position_m, s.speed_mps, 0.0) for s in seen]).reshape(-1, 3),
        np.array([(e.position_m, e.speed_mps, 0.0) for e in epochs]).reshape(-1, 3),
        np.array([(s.position_min_m, s.position_max_m, s.speed_min_mps, s.speed_max_mps) for s in seen]).reshape(-1, 4),
        np.array([math.nan if s.since_m is None else s.since_m for s in seen]),
        np.array([s.location_accuracy_m for s in seen]),
        np.array([s.status == "lost" for s in seen], dtype=bool),
    )
    found = subset_041_position(columns)
    within = found.available if found is not None and found.available is not None else np.zeros(0, dtype=bool)
    return {"subset_041_due_epochs": len(within), "subset_041_epochs": int(within.sum())}


def _errors(epochs: Sequence[Epoch], when: str) -> dict[str, Any]:
    return {
        f"position_error_{when}_max_m": max((abs(e.state.position_m - e.position_m) for e in epochs), default=None),
        f"speed_error_{when}_max_mps": max((abs(e.state.speed_mps - e.speed_mps) for e in epochs), default=None),
    }


def _detection(epochs: Sequence[Epoch], spells: Sequence[Spell], said: Sequence[Said]) -> dict[str, Any]:
    """When all liars have been excluded, doubted and named by a warning: the largest of the times since their onsets."""
    times = [_since(spell, (e.t_s for e in epochs if spell.unit in e.excluded)) for spell in spells]
    warned = [_since(spell, (s.at_s for s in said if s.unit == spell.unit or spell.unit in s.text.split())) for spell in spells]
    doubted = [_since(spell, (e.t_s for e in epochs if spell.unit in e.state.doubted)) for spell in spells]
    return {"time_to_detect_s": _largest(times), "time_to_doubt_s": _largest(doubted), "time_to_warn_s": _largest(warned)}


def _acting(spell: Spell, telegrams: Sequence[tuple[float, str]]) -> Spell:
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


def _excused(epochs: Sequence[Epoch], slips: Slips) -> set[tuple[float, str]]:
    """The epochs of exclusions that began while the wheel slipped: it was not the train's speed that it told."""
    out: set[tuple[float, str]] = set()
    previous: dict[str, bool] = {}
    for epoch in epochs:
        previous = {unit: previous[unit] if unit in previous else slips(unit, epoch.t_s) for unit in epoch.excluded}
        out |= {(epoch.t_s, unit) for unit, slipped in previous.items() if slipped}
    return out


def _innocents(epochs: Sequence[Epoch], innocents: Sequence[str], excused: set[tuple[float, str]]) -> dict[str, Any]:
    """Exclusions of units without a fault that are heard: epochs, how often one began, and which units with which reasons."""
    counted: dict[str, dict[str, Any]] = {}
    previous: set[str] = set()
    begun = 0
    for epoch in epochs:
        state = epoch.state
        heard = [(unit, reason) for unit, reason in state.excluded if unit in innocents and unit not in state.unheard]
        now = {unit: reason for unit, reason in heard if (epoch.t_s, unit) not in excused}
        begun += len(now.keys() - previous)
        previous = set(now)
        for unit, reason in now.items():
            entry = counted.setdefault(unit, {"epochs": 0, "reasons": []})
            entry["epochs"] += 1
            if reason not in entry["reasons"] and len(entry["reasons"]) < MOST_REASONS:
                entry["reasons"].append(reason)
    return {
        "innocent_epochs": len(epochs) * len(innocents),
        "wrongly_excluded_epochs": sum(entry["epochs"] for entry in counted.values()),
        "wrong_exclusions": begun,
        "wrongly_excluded": dict(sorted(counted.items())),
    }


def _recovery(epochs: Sequence[Epoch], ended: Sequence[Spell]) -> dict[str, Any]:
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
