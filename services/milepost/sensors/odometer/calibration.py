"""A wheel's calibration that is stored from one run to the next, with a checksum and a check of plausibility."""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import asdict, dataclass
from typing import Any

DAY_NS = 86_400 * 10**9
OLDEST_DAYS = 90.0
# wheels wear from 920 to 770 mm in their life: a thousand kilometres a day take up to this share of the diameter
WEAR_PER_DAY = 2e-4
PLAUSIBLE_SIGMAS = 5.0
# the wheels of a train learned against the same radar, whose error they share: taken as independent, two of them would
# count it twice. Doubling both variances is covariance intersection with equal weights
SHARED_BY = 2.0
# a clock may be set back by this between two runs
CLOCK_NS = 60 * 10**9


@dataclass(frozen=True)
class Calibration:
    """The scale κ of a unit's wheel against the nominal diameter, with its standard deviation, at a time."""

    unit: str
    told_diameter_m: float
    scale: float
    scale_std: float
    saved_at_ns: int


def to_bytes(calibration: Calibration) -> bytes:
    """A JSON object with a CRC-32 of the rest, which detects accidents, not forgery."""
    fields = asdict(calibration)
    return json.dumps({**fields, "crc32": _checksum(fields)}, sort_keys=True).encode()


def from_bytes(kept: bytes) -> Calibration:
    """A calibration as it was written. Raises ValueError for anything else."""
    try:
        fields: Any = json.loads(kept)
        checksum = fields.pop("crc32")
        calibration = Calibration(**fields)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ValueError("not a calibration") from error
    if checksum != _checksum(fields):
        raise ValueError("its checksum is wrong")
    numbers = (calibration.told_diameter_m, calibration.scale, calibration.scale_std, calibration.saved_at_ns)
    if not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers):
        raise ValueError("not a calibration")
    return calibration


def as_knowledge(
    calibration: Calibration, unit: str, told_diameter_m: float, prior_std: float, now_ns: int
) -> tuple[float, float]:
    """A stored calibration as an observation (value, variance) beside a prior N(0, σ₀²) of the scale.

    With age d in days, σ² = 2 σ_kept² + (w d)², w the wear. The calibration contains the prior, which must not count twice:
    R = 1/(1/σ² - 1/σ₀²), z = κ R/σ², so that prior and observation together give κ and σ.
    Raises ValueError with the reason if it is refused: another unit or nominal diameter, too old or from the future, a scale
    beyond 5 σ₀, or a variance not below the prior's.
    """
    if calibration.unit != unit:
        raise ValueError(f"it is of {calibration.unit}")
    if calibration.told_diameter_m != told_diameter_m:
        raise ValueError(f"its nominal diameter is {1e3 * calibration.told_diameter_m:g} mm, not {1e3 * told_diameter_m:g}")
    if calibration.saved_at_ns > now_ns + CLOCK_NS:
        raise ValueError("it is from the future")
    days = max(now_ns - calibration.saved_at_ns, 0) / DAY_NS
    if days > OLDEST_DAYS:
        raise ValueError(f"it is {days:.0f} days old")
    if abs(calibration.scale) > PLAUSIBLE_SIGMAS * prior_std:
        raise ValueError(f"a diameter of {1e3 * told_diameter_m * (1.0 + calibration.scale):.1f} mm is not plausible")
    variance = SHARED_BY * calibration.scale_std**2 + (WEAR_PER_DAY * days) ** 2
    if not 0.0 < variance < 0.98 * prior_std**2:
        raise ValueError(f"it knows the scale to {calibration.scale_std:.3g}, no better than the prior")
    R = 1.0 / (1.0 / variance - 1.0 / prior_std**2)
    return calibration.scale * R / variance, R


def _checksum(fields: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(fields, sort_keys=True).encode())
