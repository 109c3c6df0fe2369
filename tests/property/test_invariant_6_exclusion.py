"""Invariant 6: with a unit excluded, the settled result is that of a train which never had it, whatever it said before.

A train with one unit of every kind of sensor, all behind one kind of filter, feedback on. One unit lies until the end; from
its exclusion on, every settled state is compared with that of the same train without this unit.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pytest

from examples import REMOVED, write_train
from milepost.config.train import Train, load_train
from milepost.estimation.filters import FILTERS
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.sensors import SENSORS
from milepost.simulation.faults import FaultEntry
from milepost_schemas import FusedState
from milepost_schemas.state import SAYS_NOTHING

ROOT = Path(__file__).resolve().parents[2]
# a balise every second and a half, and the geometry that some kinds need
LINE = {
    "geojson": str(ROOT / "deploy/lines/airport-maglev.geojson"),
    "length_m": REMOVED,
    "balises": {"every_m": 30.0, "from_m": 30.0},
}
NOT_BY_THE_BANK = {*SAYS_NOTHING, "refused"}
LENGTH_S = 9.0
ONSETS_S = (0.0, 2.0, 5.0)
# in the standard deviations of the train without the unit; measured: 2e-11
EXACT = 1e-9

Lie = tuple[str, dict[str, Any]]
# at once, and growing slowly from nothing
SUDDEN: dict[str, Lie] = {
    "speed_reading": ("bias", {"size": 2.0}),
    "inertial_reading": ("bias", {"size": 1.0}),
    "position_reading": ("drag", {"rate_mps": 3.0}),
    "balise_telegram": ("moved_balise", {"offset_m": 8.0, "once": False}),
}
SLOW: dict[str, Lie] = {
    **SUDDEN,
    "speed_reading": ("ramp", {"rate": 0.3}),
    "inertial_reading": ("ramp", {"rate": 0.3}),
    "position_reading": ("drag", {"rate_mps": 1.0}),
}


def name_of(kind: str) -> str:
    """The unit of a kind."""
    return kind.replace("_", "-")


def train_of(kind_of_filter: str, folder: Path, without: str | None = None) -> Train:
    """A train with a unit of every kind of sensor behind a kind of filter, but for one of these units."""
    changes: dict[str, Any] = {f"units.{unit}": REMOVED for unit in ("radar", "loop", "balise-reader")}
    changes |= {"fusion.shares": "by_accuracy", "fusion.period_ms": 100}
    changes |= {"prior.position_m": 10.0, "world.motion.start_m": 10.0}
    for kind, row in SENSORS.items():
        entry: dict[str, Any] = {"kind": kind}
        if "rate_hz" in row.options_model.model_fields:
            entry["rate_hz"] = 5.0 if row.stream == "position_reading" else 10.0
        if row.options_model.model_validate({"kind": kind}).filter is not None:
            entry["filter"] = kind_of_filter
        if kind != without:
            changes[f"units.{name_of(kind)}"] = entry
    return load_train(write_train(folder, changes, LINE))


def settled(train: Train, faults: tuple[FaultEntry, ...] = ()) -> dict[int, FusedState]:
    """The settled states by epoch."""
    states: dict[int, FusedState] = {}
    simulate(train, LENGTH_S, None, lambda state: states.__setitem__(state.measured_at_ns, state), None, faults)
    return states


@cache
def never_had(kind: str, kind_of_filter: str) -> dict[int, FusedState]:
    """The settled states of the train without the unit of a kind."""
    with TemporaryDirectory() as folder:
        return settled(train_of(kind_of_filter, Path(folder), without=kind))


class Difference(NamedTuple):
    """The largest differences of common states and of their covariance, in standard deviations, and how it came to be."""

    states: float
    covariance: float
    found_s: float
    compared: int
    others: set[str]

    @property
    def largest(self) -> float:
        return max(self.states, self.covariance)


def excluded(state: FusedState) -> set[str]:
    """The units that the bank excludes: not those of which one reading was refused, or which are silent."""
    return {entry.unit for entry in state.excluded if entry.kind not in NOT_BY_THE_BANK}


def difference(kind: str, kind_of_filter: str, onset_s: float, lies: dict[str, Lie]) -> Difference:
    """Between the train whose unit of a kind lies from `onset_s` on, and the train without it, while it is excluded."""
    unit, (fault, options) = name_of(kind), lies[SENSORS[kind].stream]
    entry = FaultEntry.model_validate({"unit": unit, "kind": fault, "from_s": onset_s, **options})
    with TemporaryDirectory() as folder:
        states = settled(train_of(kind_of_filter, Path(folder)), (entry,))
    without = never_had(kind, kind_of_filter)
    times = [at for at in states if at >= OFFLINE_START_NS + round(onset_s * 1e9)]
    # since the last exclusion; a lone odd fix is refused by itself
    found = max((at for at in times if unit not in excluded(states[at])), default=times[0])
    compared = [at for at in times if at > found]
    x, P = 0.0, 0.0
    for at in compared:
        a, b = states[at], without[at]
        sigma = np.sqrt(np.diag(b.covariance))
        apart = [a.position_m - b.position_m, a.speed_mps - b.speed_mps, a.acceleration_mps2 - b.acceleration_mps2]
        x = max(x, float(np.max(np.abs(apart) / sigma)))
        P = max(P, float(np.max(np.abs(np.subtract(a.covariance, b.covariance)) / np.outer(sigma, sigma))))
    others = set().union(*(excluded(states[at]) for at in compared)) - {unit} if compared else set()
    return Difference(x, P, (found - OFFLINE_START_NS) / 1e9, len(compared), others)


def holds(found: Difference) -> None:
    """The unit was excluded, nobody else was, and nothing is left of it."""
    assert found.compared >= 10
    assert not found.others
    assert found.largest <= EXACT, found


@pytest.mark.parametrize("onset_s", ONSETS_S)
@pytest.mark.parametrize("lies", [SUDDEN, SLOW], ids=["sudden", "slow"])
@pytest.mark.parametrize("kind", SENSORS)
def test_nothing_is_left_of_an_excluded_unit_whatever_the_onset(kind: str, lies: dict[str, Lie], onset_s: float) -> None:
    holds(difference(kind, "kalman", onset_s, lies))


@pytest.mark.parametrize("kind", SENSORS)
@pytest.mark.parametrize("kind_of_filter", sorted(set(FILTERS) - {"kalman"}))
def test_nothing_is_left_of_it_behind_any_kind_of_filter(kind_of_filter: str, kind: str) -> None:
    """A slow lie is learned from for seconds before it is found."""
    holds(difference(kind, kind_of_filter, 2.0, SLOW))
