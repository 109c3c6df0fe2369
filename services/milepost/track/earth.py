"""Short ways on the earth."""

from __future__ import annotations

import math

SEMI_MAJOR_M, FLATTENING = 6_378_137.0, 1.0 / 298.257223563


def moved(latitude_deg: float, longitude_deg: float, east_m: float, north_m: float) -> tuple[float, float]:
    """A place moved by a little on WGS84: north by the meridian's radius M, east by N cos φ."""
    phi = math.radians(latitude_deg)
    e2 = FLATTENING * (2.0 - FLATTENING)
    w = math.sqrt(1.0 - e2 * math.sin(phi) ** 2)
    meridian, normal = SEMI_MAJOR_M * (1.0 - e2) / w**3, SEMI_MAJOR_M / w
    return latitude_deg + math.degrees(north_m / meridian), longitude_deg + math.degrees(east_m / (normal * math.cos(phi)))
