"""Line files: length, balises, geometry."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from milepost.estimation.track import Balise, Line, Track
from milepost.sensors.base import DataPath
from milepost_schemas.message import Name

from .yaml_files import ConfigError, read_yaml, validate

Metres = Annotated[float, Field(ge=0.0, le=1e7)]
STRICT = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


class BaliseRow(BaseModel):
    """One balise."""

    model_config = STRICT
    id: Name
    position_m: Metres
    location_accuracy_m: Metres = 12.0


class BaliseRule(BaseModel):
    """Balises at equal distances; `id` is `prefix` and a number counted from 1."""

    model_config = STRICT
    every_m: Annotated[float, Field(ge=2.6)]
    from_m: Metres = 0.0
    prefix: Name = "b"
    location_accuracy_m: Metres = 12.0


Balises = Annotated[
    Annotated[list[BaliseRow], Tag("rows")] | Annotated[BaliseRule, Tag("rule")],
    Discriminator(lambda value: "rows" if isinstance(value, list) else "rule"),
]


class LineFile(BaseModel):
    """`length_m` is needed where there is no geometry; `geojson` is a LineString feature in the direction of chainage."""

    model_config = STRICT
    line: Name
    length_m: Annotated[float, Field(gt=0.0, le=1e7)] | None = None
    map_accuracy_m: Metres = 0.0
    geojson: DataPath | None = None
    balises: Balises = Field(default_factory=list)


def load_line(path: Path) -> Line:
    """A line from its file. Raises ConfigError."""
    file = validate(path, read_yaml(path), LineFile)
    points = _points(path, file.geojson) if file.geojson else None
    try:
        track = Track(points) if points is not None else None
    except ValueError as error:
        raise ConfigError(path, "geojson", f"{file.geojson}: {error}") from error
    length = file.length_m if file.length_m is not None else track.length_m if track else None
    if length is None:
        raise ConfigError(path, "length_m", "needed where there is no geojson")
    balises = _balises(path, file, length)
    content = {
        "line": file.line,
        "length_m": length,
        "points": points,
        "map_accuracy_m": file.map_accuracy_m,
        "balises": [[b.balise_id, b.position_m, b.location_accuracy_m] for b in balises],
    }
    return Line(file.line, length, balises, file.map_accuracy_m, track, content)


def _balises(path: Path, file: LineFile, length_m: float) -> tuple[Balise, ...]:
    if isinstance(file.balises, BaliseRule):
        rule = file.balises
        if rule.from_m > length_m:
            raise ConfigError(path, "balises.from_m", f"beyond the line's {length_m:.1f} m")
        count = int((length_m - rule.from_m) / rule.every_m) + 1
        return tuple(
            Balise(f"{rule.prefix}{i + 1:05d}", rule.from_m + i * rule.every_m, rule.location_accuracy_m) for i in range(count)
        )
    seen: set[str] = set()
    for i, row in enumerate(file.balises):
        if row.id in seen:
            raise ConfigError(path, f"balises.{i}.id", f"{row.id} stands twice")
        if row.position_m > length_m:
            raise ConfigError(path, f"balises.{i}.position_m", f"beyond the line's {length_m:.1f} m")
        seen.add(row.id)
    rows = sorted(file.balises, key=lambda row: row.position_m)
    return tuple(Balise(row.id, row.position_m, row.location_accuracy_m) for row in rows)


def _points(path: Path, geojson: Path) -> list[tuple[float, float]]:
    try:
        content: Any = json.loads(geojson.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(path, "geojson", f"{geojson}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(path, "geojson", f"{geojson}: not JSON: {error}") from error
    try:
        geometry = content.get("geometry", content)
        if geometry["type"] != "LineString":
            raise ConfigError(path, "geojson", f"{geojson}: a LineString is needed, not {geometry['type']}")
        points = [(float(p[0]), float(p[1])) for p in geometry["coordinates"]]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise ConfigError(path, "geojson", f"{geojson}: not a GeoJSON LineString") from error
    for number, (longitude, latitude) in enumerate(points, start=1):
        if not (-180.0 <= longitude <= 180.0 and -90.0 <= latitude <= 90.0):
            raise ConfigError(path, "geojson", f"{geojson}: point {number} is not a longitude and a latitude in degrees")
    return points
