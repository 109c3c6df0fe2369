"""Geometry files: GeoJSON lines and recorded paths, as points of longitude and latitude."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

from .yaml_files import ConfigError

ECEF_COLUMNS = ("ecef_x_m", "ecef_y_m", "ecef_z_m")
# recorded points closer than this would lengthen the path by their noise and turn it about
APART_M = 1.0


def geojson_points(path: Path, geojson: Path) -> list[tuple[float, float]]:
    """The points (longitude_deg, latitude_deg) of a LineString. Raises ConfigError about the line file `path`."""
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


def ecef_points(path: Path, recorded: Path) -> list[tuple[float, float]]:
    """The points (longitude_deg, latitude_deg) of a path recorded in earth-centred metres, at least 1 m apart.

    Raises ConfigError about the line file `path`.
    """
    import pyproj  # slow to import, and few lines need it

    kept: list[tuple[float, float, float]] = []
    try:
        with recorded.open(newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            for row in rows:
                point = _ecef(row, f"line {rows.line_num}")
                if not kept or math.dist(point, kept[-1]) >= APART_M:
                    kept.append(point)
    except OSError as error:
        raise ConfigError(path, "path_csv", f"{recorded}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(path, "path_csv", f"{recorded}: not CSV text") from error
    except ValueError as error:
        raise ConfigError(path, "path_csv", f"{recorded}: {error}") from error
    to_degrees = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    placed = [to_degrees.transform(*point) for point in kept]
    return [(float(longitude), float(latitude)) for longitude, latitude, _ in placed]


def _ecef(row: dict[str, Any], place: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(row[name]) for name in ECEF_COLUMNS)
    except KeyError as error:
        raise ValueError(f"{error.args[0]}: missing") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{place}: not three numbers {', '.join(ECEF_COLUMNS)}") from error
    if not 6.2e6 < math.hypot(x, y, z) < 6.5e6:
        raise ValueError(f"{place}: {', '.join(ECEF_COLUMNS)} is no place on the earth")
    return x, y, z
