"""The figures of one run: interval, errors, exclusions, from live states and the truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from milepost.checks.published import Array, Flags
from milepost.checks.requirements import subset_041_position

from .epoch import Epoch, Spell
from .exclusions import Slips, acting, detection, excused, grips, innocents, recovery
from .watch import Watch


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
    figures |= detection(after, [acting(spell, watch.telegrams) for spell in spells if spell.acts], watch.said)
    figures |= innocents(after, sorted(set(units) - {spell.unit for spell in spells}), excused(epochs, slips))
    figures |= recovery(after, [spell for spell in spells if not math.isinf(spell.to_s)])
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
