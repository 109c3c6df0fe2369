"""A scenario on the memory bus, estimator beside estimator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from milepost.estimation.centralised import centralised
from milepost.runtime.config import Train, load_scenario
from milepost.runtime.memory_bus import Tap
from milepost.runtime.offline import OFFLINE_START_NS, simulate
from milepost.runtime.roles import full_layout, prior
from milepost.runtime.scenario_file import ScenarioFile
from milepost.runtime.yaml_files import ConfigError
from milepost.simulation.recording import RecordedFix, read_gnss_log
from milepost_schemas import FusedState

from .heard import Heard
from .scoring import Estimates, largest_difference_in_sigmas, score, score_withheld


def evaluate_once(path: Path, seed: int, also: Tap | None, show: Any) -> tuple[dict[str, Any], Heard, dict[str, Estimates]]:
    """One seed: the figures, what was said, and every estimator's states."""
    scenario, train = load_scenario(path, seed)
    # what cannot be compared afterwards is said before the work, not after it
    for unit in scenario.alone:
        if unit not in train.fused_units:
            raise ConfigError(path, "alone", f"{unit} has no filter in {train.path}")
    fixes = withheld_fixes(path, scenario, train) if scenario.withheld is not None else []
    heard = Heard(train, also)
    simulate(train, scenario.duration_s, heard.tap, heard.keep, show)
    _, federated_train = load_scenario(path, seed, rule="federated")
    federated = Heard(federated_train)
    simulate(federated_train, scenario.duration_s, federated.tap, None, lambda t: show(scenario.duration_s + t))
    estimators: dict[str, Estimates] = {
        "fused": _of_states(heard.settled),
        "federated": _of_states(federated.live),
        "centralised": _centralised(heard, train, None),
    }
    for unit in scenario.alone:
        estimators[f"{unit}_only"] = _centralised(heard, train, unit)
    result: dict[str, Any] = {"scenario": scenario.scenario, "seed": seed, "duration_s": scenario.duration_s}
    result["estimators"] = {
        name: score(estimates, heard.truth, OFFLINE_START_NS, scenario.speed_after_s) for name, estimates in estimators.items()
    }
    fused, best = result["estimators"]["fused"], result["estimators"]["centralised"]
    result["fused_over_centralised"] = fused["position_rms_m"] / best["position_rms_m"]
    result["fused_minus_centralised_max_sigma"] = largest_difference_in_sigmas(estimators["fused"], estimators["centralised"])
    if scenario.withheld is not None:
        period_ns = train.file.fusion.period_ms * 1_000_000
        result |= score_withheld(heard.settled, fixes, train.line, OFFLINE_START_NS, period_ns)
    return result, heard, estimators


def withheld_fixes(path: Path, scenario: ScenarioFile, train: Train) -> list[RecordedFix]:
    """The RTK fixes of the withheld span. Raises ConfigError where the filters would see them, or there is none to see."""
    withheld = scenario.withheld
    assert withheld is not None
    options: Any = train.sensors[withheld.unit].options if withheld.unit in train.sensors else None
    if getattr(options, "recording", None) is None:
        raise ConfigError(path, "withheld.unit", f"{withheld.unit} has no recording")
    if not any(a <= withheld.from_s and withheld.to_s <= b for a, b in options.withhold_s):
        raise ConfigError(path, "withheld", f"units.{withheld.unit}.withhold_s does not cover it")
    if withheld.to_s > scenario.duration_s:
        raise ConfigError(path, "withheld.to_s", f"the run ends before, after {scenario.duration_s:g} s")
    recorded = read_gnss_log(getattr(options.recording, "file", options.recording))
    fixes = [fix for fix in recorded if withheld.from_s <= fix.t_s < withheld.to_s and fix.solution == "rtk_fixed"]
    if not fixes:
        raise ConfigError(path, "withheld", f"{withheld.unit} has no RTK fix in it")
    return fixes


def _of_states(states: dict[int, FusedState]) -> Estimates:
    return {at: ((s.position_m, s.speed_mps, s.acceleration_mps2), s.covariance) for at, s in states.items()}


def _centralised(heard: Heard, train: Train, unit: str | None) -> Estimates:
    chosen = [o for o in heard.observations if unit is None or o.unit == unit]
    layout = full_layout(train) if unit is None else full_layout(train).only([unit])
    begins_ns = min(o.measured_at_ns for o in heard.observations)
    results = centralised(chosen, sorted(heard.truth), layout, train.file.motion_model.jerk_psd_m2ps5, prior(train), begins_ns)
    return {at: (mean, covariance) for at, mean, covariance in results}


def summary(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians over the runs, and the worst of each figure under `worst`."""
    out = {
        "scenario": results[0]["scenario"],
        "seed": results[0]["seed"],
        "duration_s": results[0]["duration_s"],
        "runs": len(results),
    }
    estimators: dict[str, Any] = {}
    for name, figures in results[0]["estimators"].items():
        values = {key: [r["estimators"][name][key] for r in results] for key in figures}
        estimators[name] = {key: float(np.median(v)) for key, v in values.items()}
        estimators[name]["worst"] = {key: max(v) for key, v in values.items()}
    out["estimators"] = estimators
    for key in (
        "fused_over_centralised",
        "fused_minus_centralised_max_sigma",
        "withheld_fixes",
        "withheld_max_m",
        "withheld_outside_interval",
    ):
        if key in results[0]:
            out[key] = max(r[key] for r in results)
    return out
