"""Golden runs: a few settled states of two scenarios, rounded. `python tests/replay/regenerate.py` writes them anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from milepost.config.scenario_file import load_scenario
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost_schemas import FusedState

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = Path(__file__).resolve().parent / "golden"
EVERY_NS = 5_000_000_000
# golden file → scenario, seconds
RUNS = {"loop-radar-balise": 20.0, "brussels-28876": 60.0}


def missing_data(name: str) -> str | None:
    """What a run needs and this machine lacks."""
    recorded = ROOT.parent / "shared/data/brussels"
    return f"../shared/data/{recorded.name} is not here" if name.startswith("brussels") and not recorded.is_dir() else None


def rounded(value: float) -> float:
    """Six significant digits."""
    return float(f"{value:.6g}")


def summary(state: FusedState) -> dict[str, Any]:
    """What a golden file keeps of a state."""
    covariance = state.covariance
    return {
        "t_s": (state.measured_at_ns - OFFLINE_START_NS) / 1e9,
        "position_m": rounded(state.position_m),
        "speed_mps": rounded(state.speed_mps),
        "position_variance_m2": rounded(covariance[0][0]),
        "speed_variance_m2ps2": rounded(covariance[1][1]),
        "acceleration_variance_m2ps4": rounded(covariance[2][2]),
        "reach_m": rounded(state.position_max_m - state.position_m),
        "status": state.status,
        "direction": state.direction,
        "sensors": [unit.unit for unit in state.sensors],
        "excluded": [unit.unit for unit in state.excluded],
        "last_balise": state.last_balise.balise_id if state.last_balise else None,
    }


def run(name: str) -> list[dict[str, Any]]:
    """The states of a golden run, as this code computes them."""
    _, train = load_scenario(ROOT / f"deploy/scenarios/{name}.yaml")
    kept: list[dict[str, Any]] = []

    def settled(state: FusedState) -> None:
        if state.measured_at_ns % EVERY_NS == 0 and state.measured_at_ns > OFFLINE_START_NS:
            kept.append(summary(state))

    simulate(train, RUNS[name], None, settled)
    return kept


def main() -> None:
    """Write every golden file that this machine has the data for."""
    GOLDEN.mkdir(exist_ok=True)
    for name in RUNS:
        if lacking := missing_data(name):
            print(f"{name}: left as it is, {lacking}")
            continue
        lines = ",\n  ".join(json.dumps(state) for state in run(name))
        (GOLDEN / f"{name}.json").write_text(f"[\n  {lines}\n]\n", encoding="utf-8")
        print(f"{name}: written. If it changed, say in CHANGELOG.md what changed in the states, and why.")


if __name__ == "__main__":
    main()
