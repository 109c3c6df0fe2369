"""THE SENSOR TABLE: one file for each kind of sensor, one row here."""

from __future__ import annotations

from typing import Any

from .balise_reader import BaliseReader
from .base import Sensor
from .doppler_radar import DopplerRadar
from .gnss import Gnss
from .imu import Imu
from .induction_loop import InductionLoop
from .janus_radar import JanusRadar
from .odometer import Odometer

SENSORS: dict[str, type[Sensor[Any]]] = {
    kind.kind: kind for kind in (DopplerRadar, JanusRadar, InductionLoop, Odometer, Imu, Gnss, BaliseReader)
}
