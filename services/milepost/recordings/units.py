"""Units of recordings: what each measures and how large it is in the unit that the field's name carries."""

from __future__ import annotations

import math
from typing import NamedTuple

# of latitude, and of longitude at the equator
METRES_PER_DEGREE = 111_200.0


class Unit(NamedTuple):
    """What is measured, and the factor to that quantity's SI unit."""

    quantity: str
    factor: float


UNITS: dict[str, Unit] = {
    "m/s": Unit("speed", 1.0),
    "cm/s": Unit("speed", 0.01),
    "mm/s": Unit("speed", 0.001),
    "km/h": Unit("speed", 1.0 / 3.6),
    "mph": Unit("speed", 0.44704),
    "kn": Unit("speed", 1852.0 / 3600.0),
    "ft/s": Unit("speed", 0.3048),
    "m": Unit("length", 1.0),
    "cm": Unit("length", 0.01),
    "mm": Unit("length", 0.001),
    "km": Unit("length", 1000.0),
    "ft": Unit("length", 0.3048),
    "mi": Unit("length", 1609.344),
    "rad": Unit("angle", 1.0),
    "mrad": Unit("angle", 0.001),
    "deg": Unit("angle", math.pi / 180.0),
    "1e-7 deg": Unit("angle", 1e-7 * math.pi / 180.0),
    "rad/s": Unit("turn rate", 1.0),
    "deg/s": Unit("turn rate", math.pi / 180.0),
    "m/s2": Unit("acceleration", 1.0),
    "g": Unit("acceleration", 9.80665),
    "mg": Unit("acceleration", 9.80665e-3),
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "us": Unit("time", 1e-6),
    "ns": Unit("time", 1e-9),
    "min": Unit("time", 60.0),
    "h": Unit("time", 3600.0),
    "m2": Unit("square of length", 1.0),
    "cm2": Unit("square of length", 1e-4),
    "mm2": Unit("square of length", 1e-6),
    "m2/s2": Unit("square of speed", 1.0),
    "km2/h2": Unit("square of speed", 1.0 / 3.6**2),
    "Hz": Unit("frequency", 1.0),
    "1": Unit("number", 1.0),
    "%": Unit("number", 0.01),
}

# the unit at the end of a field's name
SUFFIXES = {
    "mps": "m/s",
    "m": "m",
    "deg": "deg",
    "rad": "rad",
    "radps": "rad/s",
    "mps2": "m/s2",
    "s": "s",
    "m2": "m2",
    "m2ps2": "m2/s2",
    "hz": "Hz",
}


def unit_of(field: str) -> str:
    """The unit that a field's name carries; `1` where it carries none."""
    return SUFFIXES.get(field.rpartition("_")[2], "1")


def factor(unit: str, field: str) -> float:
    """What a number in `unit` is multiplied with to be the field's. Raises ValueError where the two do not fit."""
    given, wanted = UNITS.get(unit), UNITS[unit_of(field)]
    if given is None:
        raise ValueError(f"the unit must be one of {', '.join(UNITS)}, not {unit!r}")
    if given.quantity != wanted.quantity:
        raise ValueError(f"{unit} is a unit of {given.quantity}, {field} is a {wanted.quantity}")
    return given.factor / wanted.factor
