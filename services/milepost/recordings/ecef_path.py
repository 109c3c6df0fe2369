"""Paths recorded in earth-centred metres, as points of longitude and latitude."""

from __future__ import annotations

import math
from pathlib import Path

from .table import Cell, read_table

# recorded points closer than this would lengthen the path by their noise and turn it about
APART_M = 1.0
ECEF_POSITION: dict[str, Cell] = {name: Cell(name, float) for name in ("ecef_x_m", "ecef_y_m", "ecef_z_m")}
ECEF_VELOCITY: dict[str, Cell] = {name: Cell(name, float) for name in ("ecef_vx_mps", "ecef_vy_mps", "ecef_vz_mps")}
ECEF_PATH: dict[str, Cell] = {"t_s": Cell("t_s", float), **ECEF_POSITION, **ECEF_VELOCITY}


def ecef_points(recorded: Path) -> list[tuple[float, float]]:
    """The points (longitude_deg, latitude_deg) of a path recorded in earth-centred metres, at least 1 m apart.

    Raises ValueError naming file, line and column, and OSError for a file that cannot be opened.
    """
    import pyproj  # slow to import, and few lines need it

    kept: list[tuple[float, float, float]] = []
    for row in read_table(recorded, ECEF_POSITION):
        if row.error is not None:
            raise ValueError(f"{recorded}: {row.error}")
        x, y, z = row.values.values()
        if not 6.2e6 < math.hypot(x, y, z) < 6.5e6:
            raise ValueError(f"{recorded}: line {row.line}: {', '.join(ECEF_POSITION)} is no place on the earth")
        if not kept or math.dist((x, y, z), kept[-1]) >= APART_M:
            kept.append((x, y, z))
    to_degrees = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    placed = [to_degrees.transform(*point) for point in kept]
    return [(float(longitude), float(latitude)) for longitude, latitude, _ in placed]
