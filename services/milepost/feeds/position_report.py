"""A fused state as the position report of ERTMS/ETCS: packet 0 of SUBSET-026-7.

SUBSET-026-7 (issue 4.0.0), 7.4.3.1 (the packet) and 7.5.1 (the variables); SUBSET-026-3, 3.6.5.1.2 (what they mean).
Trackside of system version 2 expects the packet of issue 3.6.0: 4 bits of M_MODE, and no code for standstill in V_TRAIN.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from milepost_schemas import FusedState

NID_PACKET = 0
REVERSE, NOMINAL, UNKNOWN = 0, 1, 2
UNKNOWN_LRBG = 16777215
# 15 bits: unknown or beyond; the greatest length that can be said
UNKNOWN_LENGTH, LONGEST = 32767, 32766
# exact: a tenth as a float is none, and what is rounded outwards must not end inside
SCALES_M = (Fraction(1, 10), Fraction(1), Fraction(10))
# 7 bits in steps of 5 km/h
STEP_MPS, FASTEST = Fraction(25, 18), 120
LEVEL_NTC = 1
CONFIRMED = (1, 2)
# the variables in their order, with their bits
VARIABLES: tuple[tuple[str, int], ...] = (
    ("nid_packet", 8),
    ("l_packet", 13),
    ("q_scale", 2),
    ("nid_lrbg", 24),
    ("d_lrbg", 15),
    ("q_dirlrbg", 2),
    ("q_dlrbg", 2),
    ("l_doubtover", 15),
    ("l_doubtunder", 15),
    ("q_integrity", 2),
    ("l_trainint", 15),
    ("v_train", 7),
    ("q_dirtrain", 2),
    ("m_mode", 5),
    ("m_level", 3),
    ("nid_ntc", 8),
)
SYSTEM_VERSION = 3
# by system version: the bits of M_MODE, and the code of standstill
MODE_BITS, STANDSTILL = {2: 4, 3: 5}, {2: 0, 3: 127}


def layout(system_version: int) -> list[tuple[str, int]]:
    """The variables of a system version and their bits."""
    return [(name, MODE_BITS[system_version] if name == "m_mode" else bits) for name, bits in VARIABLES]


@dataclass(frozen=True)
class BaliseGroup:
    """A balise group: NID_C and NID_BG in one number, its place, and whether its nominal direction is against chainage."""

    nid_lrbg: int
    position_m: float
    reverse: bool = False


@dataclass(frozen=True)
class OnBoard:
    """What the report says of the train and Milepost does not know; the front end lies `front_m` ahead of its reference point.

    `reverse`: the active cab faces lower chainage. `trainint_m`: the confirmed length, with `integrity` 1 or 2.
    """

    mode: int
    level: int
    nid_ntc: int | None = None
    front_m: float = 0.0
    reverse: bool = False
    integrity: int = 0
    trainint_m: float | None = None
    system_version: int = SYSTEM_VERSION


class Distances(NamedTuple):
    """Coded lengths and their scale, and on which side of the balise group the front end is."""

    q_scale: int
    d_lrbg: int
    l_doubtover: int
    l_doubtunder: int
    q_dlrbg: int


def position_report(state: FusedState, group: BaliseGroup | None, train: OnBoard) -> dict[str, int]:
    """The variables of packet 0, by their names in lower case, in their order; `group` is the last relevant one.

    The coded distances hold the published interval of position, rounded outwards. It contains the balise's location accuracy
    already.
    """
    found: dict[str, int] = {"nid_packet": NID_PACKET, "l_packet": 0}
    if group is None:
        # the coarsest scale: whoever overlooks that they are unknown takes them for long
        distances = Distances(len(SCALES_M) - 1, UNKNOWN_LENGTH, UNKNOWN_LENGTH, UNKNOWN_LENGTH, UNKNOWN)
        facing = moving = UNKNOWN
    else:
        distances = _distances(state, group, train)
        facing = NOMINAL if train.reverse == group.reverse else REVERSE
        moving = _moving(state, group)
    found |= {
        "q_scale": distances.q_scale,
        "nid_lrbg": UNKNOWN_LRBG if group is None else group.nid_lrbg,
        "d_lrbg": distances.d_lrbg,
        "q_dirlrbg": facing,
        "q_dlrbg": distances.q_dlrbg,
        "l_doubtover": distances.l_doubtover,
        "l_doubtunder": distances.l_doubtunder,
        "q_integrity": train.integrity,
    }
    if train.integrity in CONFIRMED:
        found["l_trainint"] = min(math.ceil(train.trainint_m or 0.0), UNKNOWN_LENGTH)
    found |= {"v_train": _v_train(state, train.system_version), "q_dirtrain": moving}
    found |= {"m_mode": train.mode, "m_level": train.level}
    if train.level == LEVEL_NTC:
        found["nid_ntc"] = train.nid_ntc or 0
    found["l_packet"] = sum(bits for name, bits in layout(train.system_version) if name in found)
    return found


def packed(variables: Mapping[str, int], system_version: int = SYSTEM_VERSION) -> bytes:
    """The bits of a packet, most significant first, padded with zeros to whole bytes. Raises ValueError."""
    number = length = 0
    for name, bits in layout(system_version):
        value = variables.get(name)
        if value is None:
            continue
        if not 0 <= value < 1 << bits:
            raise ValueError(f"{name}: {value} has more than {bits} bits")
        number, length = number << bits | value, length + bits
    padding = -length % 8
    return (number << padding).to_bytes((length + padding) // 8, "big")


def unpacked(packet: bytes, system_version: int = SYSTEM_VERSION) -> dict[str, int]:
    """The variables of a packet 0. Raises ValueError for bytes that are none."""
    number, left = int.from_bytes(packet, "big"), 8 * len(packet)
    found: dict[str, int] = {}
    for name, bits in layout(system_version):
        if (name == "l_trainint" and found["q_integrity"] not in CONFIRMED) or (
            name == "nid_ntc" and found["m_level"] != LEVEL_NTC
        ):
            continue
        left -= bits
        if left < 0:
            raise ValueError(f"ends before {name}")
        found[name] = number >> left & (1 << bits) - 1
    length = 8 * len(packet) - left
    if found["nid_packet"] != NID_PACKET or found["l_packet"] != length or left >= 8:
        raise ValueError(f"is no packet 0 of {length} bits")
    return found


def _distances(state: FusedState, group: BaliseGroup, train: OnBoard) -> Distances:
    """All along the train: ahead of the balise group is positive, as the active cab sees it."""
    sign = -1 if train.reverse else 1

    def from_group(position_m: float) -> Fraction:
        return sign * (Fraction(position_m) - Fraction(group.position_m)) + Fraction(train.front_m)

    estimate = from_group(state.position_m)
    least, most = sorted(map(from_group, (state.position_min_m, state.position_max_m)))
    by_scale = [_lengths(estimate, least, most, step_m) for step_m in SCALES_M]
    q_scale = next((i for i, lengths in enumerate(by_scale) if max(lengths) <= LONGEST), len(SCALES_M) - 1)
    d_lrbg, over, under = (each if each <= LONGEST else UNKNOWN_LENGTH for each in by_scale[q_scale])
    ahead_is_nominal = train.reverse == group.reverse
    side = NOMINAL if (estimate >= 0) == ahead_is_nominal else REVERSE
    return Distances(q_scale, d_lrbg, over, under, side)


def _lengths(estimate_m: Fraction, least_m: Fraction, most_m: Fraction, step_m: Fraction) -> tuple[int, int, int]:
    """D_LRBG, L_DOUBTOVER and L_DOUBTUNDER in steps: outwards from the distance as it is coded, so that both ends are in."""
    steps = round(abs(estimate_m) / step_m)
    coded_m = (steps if estimate_m >= 0 else -steps) * step_m
    over, under = (max(math.ceil(length_m / step_m), 0) for length_m in (coded_m - least_m, most_m - coded_m))
    return steps, over, under


def _moving(state: FusedState, group: BaliseGroup) -> int:
    if state.direction not in ("forward", "backward"):
        return UNKNOWN
    return NOMINAL if (state.direction == "forward") != group.reverse else REVERSE


def _v_train(state: FusedState, system_version: int) -> int:
    """The whole steps of 5 km/h."""
    if state.direction == "standstill":
        return STANDSTILL[system_version]
    return min(math.floor(abs(Fraction(state.speed_mps)) / STEP_MPS), FASTEST)
