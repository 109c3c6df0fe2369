"""Line files: length, balises, geometry."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Discriminator, Field, StringConstraints, Tag

from milepost.recordings.ecef_path import ecef_points
from milepost.recordings.options import STRICT, DataPath, Span
from milepost.track.geojson import geojson_points
from milepost.track.line import Balise, Line, Station
from milepost.track.track import Track
from milepost_schemas.message import Name

from .yaml_files import ConfigError, read_yaml, validate

Point = tuple[float, float]
# NID_BG of ERTMS/ETCS; 16383 is unknown
NID_BG_BITS, LAST_NID_BG = 14, 16382
NidBg = Annotated[int, Field(ge=0, le=LAST_NID_BG)]
Metres = Annotated[float, Field(ge=0.0, le=1e7)]


class BaliseRow(BaseModel):
    """One balise."""

    model_config = STRICT
    id: Name
    position_m: Metres
    location_accuracy_m: Metres = 12.0
    nid_bg: NidBg | None = None
    reverse: bool = False


class BaliseRule(BaseModel):
    """Balises at equal distances; `id` is `prefix` and a number counted from 1, NID_BG is counted from `nid_bg_from`."""

    model_config = STRICT
    every_m: Annotated[float, Field(ge=2.6)]
    from_m: Metres = 0.0
    prefix: Name = "b"
    location_accuracy_m: Metres = 12.0
    nid_bg_from: NidBg | None = None


Balises = Annotated[
    Annotated[list[BaliseRow], Tag("rows")] | Annotated[BaliseRule, Tag("rule")],
    Discriminator(lambda value: "rows" if isinstance(value, list) else "rule"),
]


class StationRow(BaseModel):
    """A station, by the name that people know it by."""

    model_config = STRICT
    name: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=60)]
    position_m: Metres


# a steeper gradient than this is a mistake in the unit
STEEPEST_PERMILLE = 100.0
GradientRow = Annotated[list[float], Field(min_length=2, max_length=2)]


class LineFile(BaseModel):
    """A line; `length_m` is required where there is no geometry.

    Geometry: `geojson`, a LineString feature in the direction of chainage, or `path_csv`, a recorded path with the columns
    `ecef_x_m`, `ecef_y_m`, `ecef_z_m`. Profile: `gradient`, rows [position_m, permille], positive uphill, linear between
    them and held beyond the ends; `tunnels`, spans [from_m, to_m]. `stations`: for people alone. `nid_c`: the country or
    region of ERTMS/ETCS to which the balises' `nid_bg` belong.
    """

    model_config = STRICT
    line: Name
    length_m: Annotated[float, Field(gt=0.0, le=1e7)] | None = None
    map_accuracy_m: Metres = 0.0
    geojson: DataPath | None = None
    path_csv: DataPath | None = None
    balises: Balises = Field(default_factory=list)
    nid_c: Annotated[int, Field(ge=0, le=1023)] | None = None
    gradient: list[GradientRow] = Field(default_factory=list)
    tunnels: list[Span] = Field(default_factory=list)
    stations: list[StationRow] = Field(default_factory=list)


def load_line(path: Path) -> Line:
    """A line from its file. Raises ConfigError."""
    file = validate(path, read_yaml(path), LineFile)
    points = _points(path, file)
    try:
        track = Track(points) if points is not None else None
    except ValueError as error:
        field = "geojson" if file.geojson else "path_csv"
        raise ConfigError(path, field, f"{file.geojson or file.path_csv}: {error}") from error
    length = file.length_m if file.length_m is not None else track.length_m if track else None
    if length is None:
        raise ConfigError(path, "length_m", "required where there is no geometry")
    balises = _balises(path, file, length)
    gradient, tunnels = _gradient(path, file, length), _tunnels(path, file, length)
    content: dict[str, Any] = {
        "line": file.line,
        "length_m": length,
        "points": points,
        "map_accuracy_m": file.map_accuracy_m,
        "balises": [[b.balise_id, b.position_m, b.location_accuracy_m] for b in balises],
    }
    # a line without identities keeps the hash that it had before there were any
    if any(b.nid_lrbg is not None for b in balises):
        content["etcs"] = [[b.balise_id, b.nid_lrbg, b.reverse] for b in balises]
    # a line without a profile keeps the hash that it had before there were profiles
    if gradient:
        content["gradient"] = gradient
    if tunnels:
        content["tunnels"] = tunnels
    # stations are for people: the same line with other names is the same line, so they are not in its content
    stations = _stations(path, file, length)
    return Line(file.line, length, balises, file.map_accuracy_m, track, content, gradient, tunnels, stations)


def _balises(path: Path, file: LineFile, length_m: float) -> tuple[Balise, ...]:
    if isinstance(file.balises, BaliseRule):
        rule = file.balises
        if rule.from_m > length_m:
            raise ConfigError(path, "balises.from_m", f"beyond the line's {length_m:.1f} m")
        count = int((length_m - rule.from_m) / rule.every_m) + 1
        first = rule.nid_bg_from
        if first is not None and first + count - 1 > LAST_NID_BG:
            raise ConfigError(path, "balises.nid_bg_from", f"the last of {count} balises would be beyond {LAST_NID_BG}")
        identities = [_nid_lrbg(path, file, None if first is None else first + i) for i in range(count)]
        return tuple(
            Balise(f"{rule.prefix}{i + 1:05d}", rule.from_m + i * rule.every_m, rule.location_accuracy_m, identities[i])
            for i in range(count)
        )
    seen: set[str | int] = set()
    for i, row in enumerate(file.balises):
        if row.id in seen:
            raise ConfigError(path, f"balises.{i}.id", f"duplicate balise {row.id}")
        if row.nid_bg in seen:
            raise ConfigError(path, f"balises.{i}.nid_bg", f"duplicate balise group {row.nid_bg}")
        if row.position_m > length_m:
            raise ConfigError(path, f"balises.{i}.position_m", f"beyond the line's {length_m:.1f} m")
        seen |= {row.id} if row.nid_bg is None else {row.id, row.nid_bg}
    rows = sorted(file.balises, key=lambda row: row.position_m)
    return tuple(
        Balise(row.id, row.position_m, row.location_accuracy_m, _nid_lrbg(path, file, row.nid_bg), row.reverse) for row in rows
    )


def _nid_lrbg(path: Path, file: LineFile, nid_bg: int | None) -> int | None:
    """NID_C (10 bits) and NID_BG (14 bits) in one number."""
    if nid_bg is None:
        return None
    if file.nid_c is None:
        raise ConfigError(path, "nid_c", "required where balises have a `nid_bg`")
    return file.nid_c << NID_BG_BITS | nid_bg


def _points(path: Path, file: LineFile) -> list[Point] | None:
    if file.geojson and file.path_csv:
        raise ConfigError(path, "path_csv", "must not stand beside geojson")
    if file.geojson:
        return _read(path, "geojson", file.geojson, geojson_points)
    return _read(path, "path_csv", file.path_csv, ecef_points) if file.path_csv else None


def _read(path: Path, field: str, geometry: Path, read: Callable[[Path], list[Point]]) -> list[Point]:
    try:
        return read(geometry)
    except OSError as error:
        raise ConfigError(path, field, f"{geometry}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(path, field, str(error)) from error


def _gradient(path: Path, file: LineFile, length_m: float) -> tuple[tuple[float, float], ...]:
    before = -math.inf
    for i, (position_m, permille) in enumerate(file.gradient):
        if position_m <= before:
            raise ConfigError(path, f"gradient.{i}", "positions must increase")
        if position_m < 0.0:
            raise ConfigError(path, f"gradient.{i}", "position must not be below 0")
        if abs(permille) >= STEEPEST_PERMILLE:
            raise ConfigError(path, f"gradient.{i}", f"must be within ±{STEEPEST_PERMILLE:g} permille, not {permille:g}")
        if position_m > length_m:
            raise ConfigError(path, f"gradient.{i}", f"beyond the line's {length_m:.1f} m")
        before = position_m
    return tuple((position_m, permille / 1000.0) for position_m, permille in file.gradient)


def _tunnels(path: Path, file: LineFile, length_m: float) -> tuple[tuple[float, float], ...]:
    before = 0.0
    for i, (from_m, to_m) in enumerate(file.tunnels):
        if from_m < before:
            raise ConfigError(path, f"tunnels.{i}", f"begins before {before:.1f} m, in the last tunnel or before the line")
        if to_m > length_m:
            raise ConfigError(path, f"tunnels.{i}", f"beyond the line's {length_m:.1f} m")
        before = to_m
    return tuple((from_m, to_m) for from_m, to_m in file.tunnels)


def _stations(path: Path, file: LineFile, length_m: float) -> tuple[Station, ...]:
    for i, row in enumerate(file.stations):
        if row.position_m > length_m:
            raise ConfigError(path, f"stations.{i}.position_m", f"beyond the line's {length_m:.1f} m")
    return tuple(sorted((Station(row.name, row.position_m) for row in file.stations), key=lambda each: each.position_m))
