"""Faults of sensors on the memory bus: what leaves the sensor's process is what everything behind it gets."""

from __future__ import annotations

from pathlib import Path

import pytest

from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.nodes.base import Output
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.simulation.faults import FaultEntry
from milepost_schemas import Message, SpeedReading

ROOT = Path(__file__).resolve().parents[2]
MAGLEV = load_train(ROOT / "deploy/trains/maglev.yaml")


def sent(unit: str, *faults: FaultEntry, duration_s: float = 2.0) -> list[Message]:
    """The readings of a unit of the maglev train as they leave its process."""
    out: list[Message] = []

    def tap(output: Output, now_ns: int) -> None:  # noqa: ARG001
        if output.unit == unit and output.stream == MAGLEV.sensors[unit].stream:
            out.append(output.message)

    simulate(MAGLEV, duration_s, tap, faults=faults)
    return out


def test_a_bias_acts_on_its_unit_in_its_span() -> None:
    honest = sent("radar")
    lying = sent("radar", FaultEntry(unit="radar", kind="bias", from_s=0.5, for_s=1.0, size=0.25))
    assert len(honest) == len(lying) > 100
    for before, after in zip(honest, lying, strict=True):
        assert isinstance(before, SpeedReading) and isinstance(after, SpeedReading)
        on = 0.5 <= (before.measured_at_ns - OFFLINE_START_NS) * 1e-9 < 1.5
        assert before.speed_mps is not None
        assert after == before.model_copy(update={"speed_mps": before.speed_mps + (0.25 if on else 0.0)})


def test_a_fault_of_a_unit_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"maglev.yaml: faults.0.unit: .*did you mean 'radar'"):
        sent("radar", FaultEntry(unit="radr", kind="stuck", from_s=0.0))


def test_a_fault_that_does_not_fit_the_unit_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"faults.0.kind: radar: jump does not fit a speed_reading, but position_reading"):
        sent("radar", FaultEntry(unit="radar", kind="jump", from_s=0.0, size=5.0))
