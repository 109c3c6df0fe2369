"""THE SENSOR TABLE: one file, or one package, for each kind of sensor; one row here."""

from __future__ import annotations

from typing import Any

from .balise_reader import BaliseReader
from .base import Sensor
from .gnss.gnss import Gnss
from .imu.imu import Imu
from .loop.induction_loop import InductionLoop
from .odometer.odometer import Odometer
from .radar.doppler_radar import DopplerRadar
from .radar.janus_radar import JanusRadar

SENSORS: dict[str, type[Sensor[Any]]] = {
    kind.kind: kind
    for kind in (
        DopplerRadar,
        JanusRadar,
        InductionLoop,
        Odometer,
        Imu,
        Gnss,
        BaliseReader,
    )
}
