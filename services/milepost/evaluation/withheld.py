"""Fixes that are withheld from the filters, compared with the state afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from milepost.config.scenario_file import ScenarioFile
from milepost.config.train import Train
from milepost.config.yaml_files import ConfigError
from milepost.estimation.time_units import NS_PER_S, S_PER_NS
from milepost.recordings.gnss_log import RecordedFix
from milepost.track.line import Line
from milepost_schemas import FusedState

from .recorded_scores import check_recorded_unit, replayed_fixes


def withheld_fixes(path: Path, scenario: ScenarioFile, train: Train) -> list[RecordedFix]:
    """The fixes of the withheld span that the sensor would replay, of the solution that they are compared at.

    Raises ConfigError where the filters would see them, or there are none.
    """
    withheld = scenario.withheld
    assert withheld is not None
    check_recorded_unit(path, "withheld.unit", train, withheld.unit, "position_reading")
    withhold_s = train.sensors[withheld.unit].options.withhold_s
    if not any(a <= withheld.from_s and withheld.to_s <= b for a, b in withhold_s):
        raise ConfigError(path, "withheld", f"units.{withheld.unit}.withhold_s does not cover it")
    if withheld.to_s > scenario.duration_s:
        raise ConfigError(path, "withheld.to_s", f"the run ends before, after {scenario.duration_s:g} s")
    replayed = replayed_fixes(train, withheld.unit)
    fixes = [fix for fix in replayed if withheld.from_s <= fix.t_s < withheld.to_s and fix.solution == withheld.solution]
    if not fixes:
        raise ConfigError(path, "withheld", f"{withheld.unit} has no fix with the solution {withheld.solution} in it")
    return fixes


def score_withheld(
    states: Mapping[int, FusedState], fixes: Sequence[RecordedFix], line: Line, start_ns: int, period_ns: int
) -> dict[str, float | int]:
    """Withheld fixes against the state: the epoch before each, carried to its time by its own speed and acceleration.

    Raises ValueError for a line without geometry, and where there is no state at a fix.
    """
    if line.track is None:
        raise ValueError("withheld fixes need a line with geometry")
    worst, outside = 0.0, 0
    for fix in fixes:
        at = start_ns + round(fix.t_s * NS_PER_S)
        state = states.get(at // period_ns * period_ns)
        if state is None:
            raise ValueError(f"there is no state at the withheld fix of {fix.t_s:g} s")
        t = (at - state.measured_at_ns) * S_PER_NS
        moved = t * (state.speed_mps + 0.5 * t * state.acceleration_mps2)
        position = line.track.project(fix.latitude_deg, fix.longitude_deg).position_m
        worst = max(worst, abs(state.position_m + moved - position))
        outside += not state.position_min_m <= position - moved <= state.position_max_m
    return {"withheld_fixes": len(fixes), "withheld_max_m": worst, "withheld_outside_interval": outside}
