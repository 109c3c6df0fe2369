"""A line: its chainage, its balises, its profile and, where it has geometry, its track on the earth."""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .track import Track

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Balise:
    """A balise and its chainage, which is known to within `location_accuracy_m`.

    `nid_lrbg`: the identity of its group in ERTMS/ETCS, NID_C and NID_BG in one number, where it has one; `reverse`: the
    group's nominal direction is against chainage.
    """

    balise_id: str
    position_m: float
    location_accuracy_m: float
    nid_lrbg: int | None = None
    reverse: bool = False


class Station(NamedTuple):
    """A place where trains stop, for people: nothing is computed from it."""

    name: str
    position_m: float


@dataclass(frozen=True)
class Line:
    """A line: name, length, balises in order of chainage, map accuracy, and optional geometry and profile.

    `gradient`: (position_m, slope) in order of position, slope in metres of rise per metre, linear between them.
    `tunnels`: (from_m, to_m), in order, apart from each other. `stations` in order of position.
    """

    name: str
    length_m: float
    balises: tuple[Balise, ...]
    map_accuracy_m: float = 0.0
    track: Track | None = None
    content: dict[str, Any] = field(default_factory=dict, repr=False)
    gradient: tuple[tuple[float, float], ...] = ()
    tunnels: tuple[tuple[float, float], ...] = ()
    stations: tuple[Station, ...] = ()

    def slope_at(self, position_m: float) -> float:
        """Rise per metre of travel towards higher chainage; level where no gradient is known, held beyond the ends."""
        gradient = self.gradient
        if not gradient:
            return 0.0
        i = bisect_right(gradient, position_m, key=_position)
        if i == 0 or i == len(gradient):
            return gradient[min(i, len(gradient) - 1)][1]
        (from_m, from_slope), (to_m, to_slope) = gradient[i - 1], gradient[i]
        return from_slope + (position_m - from_m) / (to_m - from_m) * (to_slope - from_slope)

    def slopes_at(self, positions_m: Array) -> Array:
        """`slope_at` at many positions."""
        if not self.gradient:
            return np.zeros_like(positions_m)
        at_m, slopes = self._profile
        return np.interp(positions_m, at_m, slopes)

    @cached_property
    def _profile(self) -> tuple[Array, Array]:
        at_m, slopes = np.array(self.gradient).T
        return at_m, slopes

    def in_tunnel(self, position_m: float) -> bool:
        """Whether a position lies in a tunnel, [from, to)."""
        i = bisect_right(self.tunnels, position_m, key=_position)
        return i > 0 and position_m < self.tunnels[i - 1][1]

    @property
    def content_hash(self) -> str:
        """The first 16 hex digits of the SHA-256 of the line's content: processes with the same line have the same hash."""
        text = json.dumps(self.content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _position(row: tuple[float, float]) -> float:
    return row[0]
