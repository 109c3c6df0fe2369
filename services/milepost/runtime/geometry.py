"""Geometry files: GeoJSON lines and recorded paths, as points of longitude and latitude."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from milepost.simulation.recording import ECEF_POSITION
from milepost.simulation.table import read_table

from .yaml_files import ConfigError

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
        for row in read_table(recorded, ECEF_POSITION):
            if row.error is not None:
                raise ValueError(f"{recorded}: {row.error}")
            x, y, z = row.values.values()
            if not 6.2e6 < math.hypot(x, y, z) < 6.5e6:
                raise ValueError(f"{recorded}: line {row.line}: {', '.join(ECEF_POSITION)} is no place on the earth")
            if not kept or math.dist((x, y, z), kept[-1]) >= APART_M:
                kept.append((x, y, z))
    except OSError as error:
        raise ConfigError(path, "path_csv", f"{recorded}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(path, "path_csv", str(error)) from error
    to_degrees = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    placed = [to_degrees.transform(*point) for point in kept]
    return [(float(longitude), float(latitude)) for longitude, latitude, _ in placed]
