"""Golden runs: a few settled states and private states, rounded. `python tests/replay/regenerate.py` writes them anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from milepost.config.scenario_file import load_scenario
from milepost.config.train import Train, load_train
from milepost.nodes.base import Output
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost_schemas import Feedback, FusedState

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = Path(__file__).resolve().parent / "golden"
EVERY_NS = 5_000_000_000
# golden file, named after a scenario or else a train → seconds. The odometers of `metro` spin and slide before 80 s.
RUNS = {"loop-radar-balise": 20.0, "brussels-28876": 60.0, "metro": 80.0, "full": 20.0}


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


def train_of(name: str) -> Train:
    """The train of a golden run."""
    scenario = ROOT / f"deploy/scenarios/{name}.yaml"
    return load_scenario(scenario)[1] if scenario.is_file() else load_train(ROOT / f"deploy/trains/{name}.yaml")


def private_states(feedback: Feedback) -> dict[str, list[float]]:
    """Mean and variance of each private state that the fuser feeds back."""
    fused = feedback.fused
    return {
        name: [rounded(fused.mean[i]), rounded(fused.covariance[i][i])] for i, name in enumerate(fused.states) if "." in name
    }


def run(name: str) -> list[dict[str, Any]]:
    """The states of a golden run, as this code computes them; with private states where the train has some."""
    kept: list[dict[str, Any]] = []
    private: dict[float, dict[str, list[float]]] = {}

    def listen(output: Output, now_ns: int) -> None:
        message = output.message
        if isinstance(message, Feedback) and message.measured_at_ns % EVERY_NS == 0:
            private[(message.measured_at_ns - OFFLINE_START_NS) / 1e9] = private_states(message)

    def settled(state: FusedState) -> None:
        if state.measured_at_ns % EVERY_NS == 0 and state.measured_at_ns > OFFLINE_START_NS:
            kept.append(summary(state))

    simulate(train_of(name), RUNS[name], listen, settled)
    return [{**state, "private": private[state["t_s"]]} if private[state["t_s"]] else state for state in kept]


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
