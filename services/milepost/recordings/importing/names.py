"""What the name of a column says: its words, and the unit among them."""

from __future__ import annotations

import re
import unicodedata

SPELLINGS: dict[str, dict[str, tuple[str, ...]]] = {
    "speed": {
        "m/s": ("mps", "ms", "msec", "mpers", "ms1"), "km/h": ("kmh", "kph", "kmph", "kmhr"), "mph": ("mph", "mih"),
        "kn": ("kn", "kt", "kts", "knot", "knots"), "ft/s": ("fps", "fts"), "cm/s": ("cmps", "cms"), "mm/s": ("mmps", "mms"),
    },
    "length": {
        "m": ("m", "meter", "meters", "metre", "metres"), "ft": ("ft", "feet", "foot"), "cm": ("cm",), "mm": ("mm",),
        "km": ("km",),
    },
    "angle": {"deg": ("deg", "degree", "degrees"), "1e-7 deg": ("e7", "1e7"), "rad": ("rad",)},
    "time": {
        "s": ("s", "sec", "secs", "second", "seconds"), "ms": ("ms", "msec", "millis", "milliseconds"),
        "us": ("us", "usec", "micros", "microseconds"), "ns": ("ns", "nsec", "nanos", "nanoseconds"),
    },
    "acceleration": {"m/s2": ("mps2", "ms2", "mss"), "g": ("g",), "mg": ("mg",)},
    "turn rate": {"rad/s": ("radps", "rads", "radpers"), "deg/s": ("degps", "degs", "dps", "degpers")},
    "number": {"1": ()},
}  # fmt: skip
LONGEST_UNIT = 3


def words_of(name: str) -> list[str]:
    """The words of a name in small letters, without accents: `GPSSpeed_km/h` is gps, speed, km, h."""
    plain = "".join(c for c in unicodedata.normalize("NFKD", name.replace("ß", "ss")) if not unicodedata.combining(c))
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+\d*|[A-Z]+|\d+", plain)]


def unit_in(words: list[str], quantity: str) -> tuple[str | None, int]:
    """The unit at the end of a name and how many words it takes; None and 0 where there is none."""
    for count in range(min(LONGEST_UNIT, len(words) - 1), 0, -1):
        ending = "".join(words[-count:])
        for unit, spellings in SPELLINGS[quantity].items():
            if ending in spellings:
                return unit, count
    return None, 0


def as_unit(text: str, quantity: str) -> str | None:
    """A unit as people write it, by the name that column maps have; None where it is none of this quantity."""
    ending = "".join(words_of(text)) or text
    for unit, spellings in SPELLINGS[quantity].items():
        if text == unit or ending in spellings:
            return unit
    return None
