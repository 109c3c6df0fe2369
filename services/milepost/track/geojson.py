"""GeoJSON lines, as points of longitude and latitude."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def geojson_points(geojson: Path) -> list[tuple[float, float]]:
    """The points (longitude_deg, latitude_deg) of a LineString.

    Raises ValueError naming the file, and OSError for a file that cannot be opened.
    """
    try:
        content: Any = json.loads(geojson.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{geojson}: not JSON: {error}") from error
    try:
        geometry = content.get("geometry", content)
        kind, coordinates = geometry["type"], geometry["coordinates"] if geometry["type"] == "LineString" else []
        points = [(float(p[0]), float(p[1])) for p in coordinates]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise ValueError(f"{geojson}: not a GeoJSON LineString") from error
    if kind != "LineString":
        raise ValueError(f"{geojson}: must be a LineString, not {kind}")
    for number, (longitude, latitude) in enumerate(points, start=1):
        if not (-180.0 <= longitude <= 180.0 and -90.0 <= latitude <= 90.0):
            raise ValueError(f"{geojson}: point {number} is not a longitude and a latitude in degrees")
    return points
