"""A ride as the logs of an import have it, and the log written to a file."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from milepost.track.earth import moved

BEGAN_S = 1_700_000_000.0
SPEED_MPS, SECONDS, RADIUS_M = 15.0, 60, 800.0


class At(NamedTuple):
    """Where the train is: time, latitude, longitude."""

    t: float
    lat: float
    lon: float


def ride(rate_hz: float = 1.0, noise_m: float = 0.3, turn_at_s: float | None = None) -> list[At]:
    """A train at 15 m/s on a curve to the left, which goes back at `turn_at_s`."""
    noise, out = random.Random(1), []
    for i in range(round(SECONDS * rate_hz) + 1):
        t = i / rate_hz
        s = SPEED_MPS * (t if turn_at_s is None or t < turn_at_s else 2.0 * turn_at_s - t)
        angle = s / RADIUS_M
        east, north = RADIUS_M * (1.0 - math.cos(angle)), RADIUS_M * math.sin(angle)
        place = moved(50.9, 4.5, -east + noise.gauss(0.0, noise_m), north + noise.gauss(0.0, noise_m))
        out.append(At(t, *place))
    return out


def iso(t: float) -> str:
    return datetime.fromtimestamp(BEGAN_S + t, UTC).isoformat().replace("+00:00", "Z")


def write(folder: Path, lines: Sequence[str], encoding: str = "utf-8") -> Path:
    path = folder / "My Run.csv"
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path
