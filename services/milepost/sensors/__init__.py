"""THE SENSOR TABLE: one file, or one package, for each kind of sensor; a row here or an entry point."""

from __future__ import annotations

from typing import Any

from milepost.estimation.kinds import Kinds
from milepost_schemas import BY_NAME

from .balise_reader import BaliseReader
from .base import Sensor, SensorOptions
from .gnss.gnss import Gnss
from .imu.imu import Imu
from .loop.induction_loop import InductionLoop
from .odometer.odometer import Odometer
from .radar.doppler_radar import DopplerRadar
from .radar.janus_radar import JanusRadar

GROUP = "milepost.sensors"
READINGS = tuple(name for name, row in BY_NAME.items() if row.key == "reading/{unit}")


def _mistake(kind: type[Sensor[Any]]) -> str:
    """What is wrong with a kind of another distribution; empty where nothing is."""
    if getattr(kind, "stream", None) not in READINGS:
        return f"its `stream` must be one of {', '.join(READINGS)}, not {getattr(kind, 'stream', None)!r}"
    if not (isinstance(kind.options_model, type) and issubclass(kind.options_model, SensorOptions)):
        return "its `options_model` is not a subclass of milepost.sensors.base.SensorOptions"
    return ""


SENSORS: Kinds[type[Sensor[Any]]] = Kinds(
    GROUP,
    Sensor,
    (
        DopplerRadar,
        JanusRadar,
        InductionLoop,
        Odometer,
        Imu,
        Gnss,
        BaliseReader,
    ),
    _mistake,
)
