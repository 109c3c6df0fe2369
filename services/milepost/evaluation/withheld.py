"""Fixes that no filter saw, compared with the state afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from milepost.config.scenario_file import ScenarioFile
from milepost.config.train import Train
from milepost.config.yaml_files import ConfigError
from milepost.recordings.gnss_log import RecordedFix, read_gnss_log
from milepost.track.line import Line
from milepost_schemas import FusedState


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
    recorded = read_gnss_log(options.recording.file)
    fixes = [fix for fix in recorded if withheld.from_s <= fix.t_s < withheld.to_s and fix.solution == "rtk_fixed"]
    if not fixes:
        raise ConfigError(path, "withheld", f"{withheld.unit} has no RTK fix in it")
    return fixes


def score_withheld(
    states: Mapping[int, FusedState], fixes: Sequence[RecordedFix], line: Line, start_ns: int, period_ns: int
) -> dict[str, float | int]:
    """Withheld fixes against the state: the epoch before each, carried to its time by its own speed and acceleration."""
    if line.track is None:
        raise ValueError("withheld fixes need a line with geometry")
    worst, outside = 0.0, 0
    for fix in fixes:
        at = start_ns + round(fix.t_s * 1e9)
        state = states[at // period_ns * period_ns]
        t = (at - state.measured_at_ns) * 1e-9
        moved = t * (state.speed_mps + 0.5 * t * state.acceleration_mps2)
        position = line.track.project(fix.latitude_deg, fix.longitude_deg).position_m
        worst = max(worst, abs(state.position_m + moved - position))
        outside += not state.position_min_m <= position - moved <= state.position_max_m
    return {"withheld_fixes": len(fixes), "withheld_max_m": worst, "withheld_outside_interval": outside}
