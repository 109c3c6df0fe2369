"""The units of an imported train: their entries in the train file, with what each figure is based on."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from milepost.recordings.importing.source import Recording

# what a receiver's solutions err by from fix to fix, and slowly: the figures of the shipped trains
FIX_STD_M = {"rtk_fixed": 0.1, "rtk_float": 0.5, "differential": 1.0, "single": 1.0}
OFFSET_STD_M = {"differential": 0.5, "single": 1.1}
SEEN = 1.2
RTK_LIMIT_M, LIMIT_M = 10.0, 25.0
WIDEST = 110


@dataclass(frozen=True)
class UnitEntry:
    """A unit: its name, kind, recording, the recording's file as the train file names it, and lines with its options."""

    name: str
    kind: str
    recording: Recording
    file: str
    options: list[str]
    average_s: float | None = None

    def lines(self) -> list[str]:
        """Its lines in a train file."""
        recording = self.recording
        about = [f"  # a copy of {recording.log.name}: {recording.copy.why}"] if recording.copy else []
        out = [
            *about,
            f"  {self.name}:",
            f"    kind: {self.kind}",
            "    source: recording",
            *(f"    {each}" for each in self.options),
        ]
        out += ["    recording:", f"      file: {flow(self.file)}", f"      time: {flow(recording.time)}", "      columns:"]
        for field, entry in recording.columns.items():
            if isinstance(entry, list):
                out += [f"        {field}:", *(f"          - {flow(each)}" for each in entry)]
            else:
                out += _entry(field, entry)
        out += [f"      constants: {flow(recording.constants)}"] if recording.constants else []
        return out + (
            [f"      average_s: {self.average_s:g} # means, as a filter needs no faster readings"] if self.average_s else []
        )


def file_of(recording: Recording, folder: Path) -> str:
    """A recording's file as a train file in a folder names it."""
    return recording.copy.name if recording.copy else relative(recording.log, folder)


def relative(path: Path, folder: Path) -> str:
    """A path as a file in a folder names it."""
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def flow(value: Any) -> str:
    """A value as YAML in one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=10**9, allow_unicode=True, sort_keys=False)
    return text.removesuffix("\n").removesuffix("\n...")


def _entry(field: str, entry: dict[str, Any]) -> list[str]:
    line = f"        {field}: {flow(entry)}"
    if len(line) <= WIDEST or "values" not in entry:
        return [line]
    words = [f"            {flow(word)}: {meant}" for word, meant in entry["values"].items()]
    return [f"        {field}:", f"          column: {flow(entry['column'])}", "          values:", *words]


def gnss_options(solutions: Sequence[str], noise_m: float, rate_hz: float, stated: bool, speed: bool, alone: bool) -> list[str]:
    """The options of a receiver. `stated`: its log has accuracies; `speed`: and speeds; `alone`: no other unit is there."""
    # no less than what is seen from fix to fix: else an honest receiver would be taken for a liar
    white = {each: round(max(min(max(3.0 * noise_m, 0.2), FIX_STD_M[each]), SEEN * noise_m), 2) for each in OFFSET_STD_M}
    known = [each for each in FIX_STD_M if each in solutions]
    stds = {each: white.get(each, max(FIX_STD_M[each], round(2.0 * noise_m, 2))) for each in known}
    offsets = {each: OFFSET_STD_M[each] for each in known if each in OFFSET_STD_M}
    out = [
        f"rate_hz: {rate_hz:g}",
        f"position_std_m: {flow(stds)} # from fix to fix; a solution that is not listed does not count",
    ]
    out += [f"offset_std_m: {flow(offsets)} # what changes slowly: atmosphere, reflections"] if offsets else []
    out += ["trust_stated_std: true # of one axis; the log's accuracy is taken for the radial one"] if stated else []
    out += ["speed_std_mps: 0.2"] if speed else []
    out.append(f"cross_track_limit_m: {LIMIT_M if offsets else RTK_LIMIT_M:g}")
    if alone:
        # without another source the interval would hold all that the train may do while this one lies
        out.append("fault_probability: 0.0 # it is all there is, so it is trusted; take this line out beside another unit")
    return out


def wheel_options(rate_hz: float, std_mps: float, wheels: int) -> list[str]:
    """The options of a wheel whose readings are recorded."""
    together = f"; {wheels} wheels err together, so each has {wheels} times the variance" if wheels > 1 else ""
    return [
        f"rate_hz: {rate_hz:g}",
        "scale_std: 0.02 # its diameter is known to 2 %; the receiver's speeds and places tell the rest",
        "scale_noise_psd: 1.0e-7 # and wanders by 0.1 % in ten seconds",
        f"timer_s: null # recorded speeds are rounded, so they repeat; {std_mps:.2g} m/s of noise{together}",
    ]


def imu_options(rate_hz: float) -> list[str]:
    """The options of an inertial unit of unknown make on a line of unknown gradient."""
    return [
        f"rate_hz: {rate_hz:g}",
        "noise_density_mps2_rthz: 0.15",
        "bias_std_mps2: 0.5 # its pitch and the gradient are in it, which no file tells",
        "bias_time_constant_s: 30.0",
    ]
