"""THE TABLE OF IMPORTED FIELDS: what a log may have, and by which names its columns are known."""

from __future__ import annotations

from dataclasses import dataclass

ERRORS = frozenset(
    ("acc", "accuracy", "std", "sd", "sigma", "error", "err", "var", "variance", "precision", "uncertainty", "cov")
)
AXES = frozenset(("x", "y", "z", "east", "north", "up", "down", "vertical", "lateral", "e", "n"))
TURNING = frozenset(("gyro", "gyr", "turn", "yaw", "roll", "pitch", "angular", "rotation", "omega"))
WHEELS = frozenset(("wheel", "wheels", "odo", "odometer", "tacho", "tachometer", "tachograph", "axle", "obd", "can", "rad"))
ACCELERATION = frozenset(("accel", "acc", "acceleration", "specific", "force"))


@dataclass(frozen=True)
class Field:
    """A field: the words that name it, best first, those that a column of it does not have, its quantity and default unit.

    `beside`: words of which one must be there too. `least`, `most`: what its numbers lie between, in the default unit.
    """

    name: str
    quantity: str
    unit: str
    words: tuple[str, ...]
    never: frozenset[str] = frozenset()
    beside: frozenset[str] = frozenset()
    least: float = -1e12
    most: float = 1e12


def _axis(name: str, words: tuple[str, ...]) -> tuple[Field, Field]:
    letter = {"forward": "x", "right": "y", "down": "z"}[name]
    turn = {"forward": "roll", "right": "pitch", "down": "yaw"}[name]
    force = Field(
        f"accel_{name}", "acceleration", "m/s2", (*words, letter, f"a{letter}", f"acc{letter}"),
        TURNING | {"mag", "vel", "speed"}, ACCELERATION | {f"a{letter}", f"acc{letter}"},
    )  # fmt: skip
    gyro = Field(
        f"gyro_{name}", "turn rate", "rad/s", (*words, letter, turn, f"g{letter}", f"w{letter}", f"gyro{letter}"),
        ACCELERATION | {"mag", "vel"}, TURNING | {"rate", f"g{letter}", f"w{letter}", f"gyro{letter}"},
    )  # fmt: skip
    return force, gyro


FORWARD = ("forward", "fwd", "longitudinal", "front")
RIGHT = ("right", "lateral", "left", "lat")
DOWN = ("down", "vertical", "up", "vert")
_AXES = [_axis("forward", FORWARD), _axis("right", RIGHT), _axis("down", DOWN)]
_LATITUDE = ("latitude", "lat", "breite", "breitengrad")
_LONGITUDE = ("longitude", "lon", "lng", "long", "lange", "laenge", "langengrad", "laengengrad")
NOT_A_PLACE = ERRORS | ACCELERATION | {"speed", "vel"}
TIMES = ("utc", "timestamp", "datetime", "time", "zeitstempel", "zeit", "epoch", "ts", "t", "date", "datum", "tow", "itow")
FIELDS: dict[str, Field] = {
    field.name: field
    for field in (
        Field("time", "time", "s", TIMES, ERRORS | {"gap", "duration"}),
        Field("latitude", "angle", "deg", _LATITUDE, NOT_A_PLACE, least=-90.0, most=90.0),
        Field("longitude", "angle", "deg", _LONGITUDE, NOT_A_PLACE, least=-180.0, most=180.0),
        Field("height", "length", "m", ("altitude", "height", "alt", "hmsl", "elevation", "ele", "hohe", "hoehe"), ERRORS),
        Field(
            "speed", "speed", "m/s", ("speed", "sog", "gspeed", "velocity", "vel", "geschwindigkeit", "v"),
            ERRORS | AXES | TURNING | WHEELS | ACCELERATION | {"limit", "max", "min"},
        ),
        Field(
            "course", "angle", "deg", ("course", "cog", "heading", "bearing", "headmot", "track", "kurs"),
            ERRORS | {"rate", "id"}, least=-360.0, most=360.0,
        ),
        Field(
            "accuracy", "length", "m", ("hacc", "accuracy", "acc", "eph", "std", "sd", "sigma", "precision"),
            AXES | TURNING | {"speed", "velocity", "vel", "course", "heading", "time", "s", "v", "height", "alt", "altitude"}
            | {"forward", "right", "ax", "ay", "az"}, least=0.0,
        ),
        Field(
            "solution", "number", "1",
            ("quality", "qual", "solution", "fixtype", "type", "fix", "mode", "q", "rtk", "carrsoln", "status"),
            ERRORS | {"time"},
        ),
        Field("satellites", "number", "1", ("satellites", "sats", "nsat", "numsv", "numsats", "sv", "ns"), least=0.0),
        Field("hdop", "number", "1", ("hdop",), least=0.0),
        Field(
            "wheel", "speed", "m/s", ("speed", "velocity", "vel", "v", *sorted(WHEELS)), ERRORS | TURNING | ACCELERATION, WHEELS
        ),
        *(force for force, _ in _AXES),
        *(gyro for _, gyro in _AXES),
    )
}  # fmt: skip
NEEDED = ("time", "latitude", "longitude")
# of these a log may have several columns
SEVERAL = ("wheel",)
