"""The motion of the world in a train file: a speed profile, a GNSS log, a recorded path."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

from milepost.recordings.column_map import check_map, time_zero_s
from milepost.recordings.column_options import ISO, RecordingOptions
from milepost.recordings.gnss_log import GnssLog, RecordedFix, read_gnss_log
from milepost.recordings.options import STRICT, DataPath, Span
from milepost.simulation.motion import KnotMotion, Motion, Profile, WhiteJerkMotion
from milepost.simulation.recorded_motion import path_motion, smooth_motion
from milepost.track.line import Line
from milepost_schemas import PositionReading
from milepost_schemas.message import PositionM

# times of recordings are good to a microsecond
SAME_S = 1e-5
END_M = 50.0  # a motion ends so far before its line's end
Positive = Annotated[float, Field(gt=0.0)]


class WhiteJerkFile(BaseModel):
    """A simulated motion: a seeded white-jerk path around a speed profile of [time s, speed m/s] corners.

    `corner_s`: the time that a change of acceleration takes; a sharp corner needs infinite jerk.
    """

    model_config = STRICT
    kind: Literal["white_jerk"]
    profile: Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=1)]
    corner_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    start_m: PositionM = 0.0
    jerk_psd_m2ps5: Annotated[float, Field(ge=0.0)]
    driver_time_s: Annotated[float, Field(ge=30.0)] | None = None
    start_std: Annotated[list[Annotated[float, Field(ge=0.0)]], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]

    @model_validator(mode="after")
    def _increasing(self) -> WhiteJerkFile:
        times = [corner[0] for corner in self.profile]
        if times[0] != 0.0 or any(b <= a for a, b in pairwise(times)):
            raise ValueError("profile: times must start at 0 and increase")
        return self

    def build(self, line: Line, seed: int, until_s: float | None) -> Motion:
        """The motion until the line's end or `until_s`. Raises ValueError("field: ...") if it has no end."""
        profile = Profile([(corner[0], corner[1]) for corner in self.profile], self.start_m, self.corner_s)
        if self.start_m >= (end_m := line.length_m - END_M):
            raise ValueError(f"start_m: {self.start_m:g} is beyond where a motion ends, {end_m:g} m on line {line.name}")
        end_s = profile.reaches(end_m)
        if until_s is None and math.isinf(end_s):
            raise ValueError("profile: does not reach the line's end: a duration is required")
        end_s = min(end_s, until_s or end_s)
        return WhiteJerkMotion(profile, end_s, self.jerk_psd_m2ps5, self.driver_time_s, self.start_std, seed)


class RecordedFile(BaseModel):
    """The motion through a GNSS log's RTK fixes; fixes within `untrusted_s` are left out.

    `gnss_log`: a path, or a column map as a unit's `recording`.
    """

    model_config = STRICT
    kind: Literal["recorded"]
    gnss_log: GnssLog
    fix_std_m: Positive = 0.01
    jerk_psd_m2ps5: Positive = 0.01
    untrusted_s: list[Span] = Field(default_factory=list)

    @model_validator(mode="after")
    def _makes_fixes(self) -> RecordedFile:
        try:
            check_map(self.gnss_log, PositionReading)
        except ValueError as error:
            raise ValueError(f"gnss_log.{error}") from error
        return self

    def build(self, line: Line, seed: int, until_s: float | None) -> Motion:  # noqa: ARG002
        """The smoothed motion through the fixes. Raises ValueError("field: ...") where the log has too few of them."""
        if line.track is None:
            raise ValueError("gnss_log: requires a line with geometry")
        try:
            fixes = read_gnss_log(self.gnss_log, self._trusted)
            motion = smooth_motion(self.gnss_log.file, fixes, line.track, self.fix_std_m, self.jerk_psd_m2ps5)
        except (ValueError, OSError) as error:
            raise ValueError(f"gnss_log: {error}") from error
        return _until(motion, until_s)

    def check_time_zero(self, unit: str, recording: RecordingOptions) -> None:
        """Raise ValueError if a unit's recording on the same clock has another scenario time 0."""
        own, other = self.gnss_log, recording.time
        one_column = own.file == recording.file and own.time.column == other.column
        if not (one_column or own.time.unit == other.unit == ISO):
            return
        ahead_s = time_zero_s(recording) - time_zero_s(own)
        if abs(ahead_s) > SAME_S:
            text = f"{abs(ahead_s):g} s {'before' if ahead_s > 0.0 else 'after'} that of units.{unit}.recording"
            raise ValueError(f"gnss_log.time.zero_at: scenario time 0 is {text}: both must have the same zero_at")

    def _trusted(self, fix: RecordedFix) -> bool:
        return fix.solution == "rtk_fixed" and not any(a <= fix.t_s < b for a, b in self.untrusted_s)


class RecordedPathFile(BaseModel):
    """A motion recorded as positions and velocities in earth-centred metres (ECEF), such as comma2k19's."""

    model_config = STRICT
    kind: Literal["recorded_path"]
    path_csv: DataPath

    def build(self, line: Line, seed: int, until_s: float | None) -> Motion:  # noqa: ARG002
        """The motion along the line. Raises ValueError("field: ...") for a file that cannot be read."""
        if line.track is None:
            raise ValueError("path_csv: requires a line with geometry")
        try:
            return _until(path_motion(self.path_csv, line.track), until_s)
        except (ValueError, OSError) as error:
            raise ValueError(f"path_csv: {error}") from error


MotionFile = Annotated[WhiteJerkFile | RecordedFile | RecordedPathFile, Field(discriminator="kind")]


def _until(motion: KnotMotion, until_s: float | None) -> KnotMotion:
    motion.end_s = min(motion.end_s, until_s) if until_s else motion.end_s
    return motion
