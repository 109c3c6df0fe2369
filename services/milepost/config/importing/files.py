"""The text of the files: train, line, geometry, scenario."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

from .units import UnitEntry, flow

TRAIN, LINE, GEOMETRY, SCENARIO = "train.yaml", "line.yaml", "line.geojson", "scenario.yaml"
DIGITS = 8
COMMENT_WIDTH = 118


@dataclass(frozen=True)
class Withheld:
    """A span of fixes of one solution that is withheld from the filters."""

    from_s: float
    to_s: float
    solution: str


@dataclass(frozen=True)
class Imported:
    """All that a log says of its train. `line`: the line file as the train file names it; `remarks`: sentences for a reader.

    Prior: `position_m`, `speed_mps` with their standard deviations. `jerk_known`: speeds of the log show `jerk_psd`.
    """

    name: str
    log: Path
    line: str
    duration_s: float
    position_m: float
    position_std_m: float
    speed_mps: float
    speed_std_mps: float
    jerk_psd: float
    jerk_known: bool
    units: Sequence[UnitEntry]
    withheld: Withheld | None
    remarks: Sequence[str]


def train_text(train: Imported) -> str:
    """The train file."""
    origin = "from the speeds of the log" if train.jerk_known else "a train driven by hand: some 0.1 m/s³ held for a second"
    lines = [
        *_comment(f"Made by `milepost import` from {train.log.name}, to be read and edited. Paths are meant from this folder."),
        *(line for remark in train.remarks for line in _comment(remark)),
        f"train: {flow(train.name)}",
        f"line: {flow(train.line)}",
        "",
        "motion_model:",
        f"  jerk_psd_m2ps5: {train.jerk_psd:g} # {origin}",
        "",
        "prior: # before the first fix",
        f"  position_m: {train.position_m:.1f}",
        f"  position_std_m: {train.position_std_m:.1f}",
        f"  speed_mps: {train.speed_mps:.1f}",
        f"  speed_std_mps: {train.speed_std_mps:.1f}",
        "  acceleration_std_mps2: 0.5",
        "",
        "fusion:",
        "  period_ms: 100 # ten states a second",
        "  shares: by_accuracy",
        *(["  false_alarms_per_hour: 1.0e-4 # errors of recorded devices are not white"] if len(train.units) > 1 else []),
        "",
        "units:",
    ]
    for unit in train.units:
        lines += unit.lines()
    return "\n".join(lines) + "\n"


def line_text(name: str, log: Path, remarks: Sequence[str]) -> str:
    """The file of a line that was made from the track itself."""
    about = f"The way that {log.name} shows, made by `milepost import`: its arc length stands for the chainage."
    comments = [line for text in (about, *remarks) for line in _comment(text)]
    return "\n".join([*comments, f"line: {flow(name)}", f"geojson: {GEOMETRY}", ""])


def geometry_text(name: str, points: Sequence[tuple[float, float]]) -> str:
    """The geometry of a line as GeoJSON, one point in a row."""
    rows = ",\n".join(f"    [{longitude:.{DIGITS}f}, {latitude:.{DIGITS}f}]" for longitude, latitude in points)
    head = f'{{"type": "Feature", "properties": {json.dumps({"line": name})},'
    return f'{head}\n  "geometry": {{"type": "LineString", "coordinates": [\n{rows}\n  ]}}}}\n'


def scenario_text(train: Imported) -> str:
    """The scenario that replays the log offline."""
    lines = [
        *_comment(f"Replays {train.log.name}: milepost evaluate {SCENARIO}"),
        f"scenario: {flow(train.name)}",
        f"train: {TRAIN}",
        f"duration_s: {train.duration_s:.1f}",
        "seeds: 1 # nothing is simulated, so every seed is the same",
        "compare: [fused, centralised]",
    ]
    if train.withheld is None:
        lines += _comment("No span of good fixes is long enough to be withheld from the filters and compared with the states.")
        return "\n".join(lines) + "\n"
    span = f"[{train.withheld.from_s:g}, {train.withheld.to_s:g}]"
    lines += [
        *_comment("These fixes are withheld from the filters and compared with the states: how far off is it without them?"),
        f"withheld: {{unit: gnss, from_s: {span[1:-1].replace(', ', ', to_s: ')}, solution: {train.withheld.solution}}}",
        f"change: {{units: {{gnss: {{withhold_s: [{span}]}}}}}}",
        f"windows: {{withheld: [{span}]}}",
    ]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text, COMMENT_WIDTH, break_long_words=False, break_on_hyphens=False)]
