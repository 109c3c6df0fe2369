"""A line as it is drawn: its schematic and, where it has geometry, its track from above."""

from __future__ import annotations

import math
from typing import Any

from milepost.track.line import Line
from milepost.track.track import Track

# a browser draws so many without effort; the ends are always among them
MOST_POINTS, MOST_BALISES = 600, 4000
EARTH_M_PER_DEG = 111_320.0


def drawing_of(line: Line) -> dict[str, Any]:
    """Length, balises and stations [name, position_m], tunnels [from_m, to_m], track [position_m, east_m, north_m]."""
    return {
        "name": line.name,
        "length_m": round(line.length_m, 1),
        "balises": [[each.balise_id, round(each.position_m, 1)] for each in line.balises[:MOST_BALISES]],
        "balise_count": len(line.balises),
        "tunnels": [[round(from_m, 1), round(to_m, 1)] for from_m, to_m in line.tunnels],
        "stations": [[each.name, round(each.position_m, 1)] for each in line.stations],
        "track": [] if line.track is None else _plan(line.track),
    }


def _plan(track: Track) -> list[list[float]]:
    """Points of a track on a plane about its middle: a drawing needs no better one."""
    steps = min(MOST_POINTS - 1, max(1, math.ceil(track.length_m / 10.0)))
    at_m = [track.length_m * i / steps for i in range(steps + 1)]
    places = [track.locate(each) for each in at_m]
    middle_lat, middle_lon = places[len(places) // 2]
    narrower = math.cos(math.radians(middle_lat))
    return [
        [round(s, 1), round((lon - middle_lon) * EARTH_M_PER_DEG * narrower, 1), round((lat - middle_lat) * EARTH_M_PER_DEG, 1)]
        for s, (lat, lon) in zip(at_m, places, strict=True)
    ]
