"""Ways between fixes that are near each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..units import METRES_PER_DEGREE


def north_east_m(latitude: Any, longitude: Any, to_latitude: Any, to_longitude: Any) -> tuple[Any, Any]:
    """How far north and east of each place the next one is, on a sphere; degrees, numbers or arrays (n)."""
    east_deg = (to_longitude - longitude + 180.0) % 360.0 - 180.0
    return (to_latitude - latitude) * METRES_PER_DEGREE, east_deg * METRES_PER_DEGREE * np.cos(np.radians(latitude))
