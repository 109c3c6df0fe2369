"""Wheel creep: scheduled spins and slides, and wheels that are asked for more than the rail gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from milepost.config.train import load_train
from milepost.config.world.creep_file import CreepFile
from milepost.config.yaml_files import ConfigError
from milepost.simulation.creep import GRAVITY_MPS2, Adhesion, Creep, CreepEvent
from milepost.track.line import Line

TRAINS = Path(__file__).parents[2] / "deploy" / "trains"
LEVEL = Line("l", 20000.0, ())


class Steady:
    """A train at constant acceleration."""

    end_s = 1000.0

    def __init__(self, v: float = 20.0, a: float = 0.0) -> None:
        self._v, self._a = v, a

    def at(self, t_s: float) -> tuple[float, float, float]:
        return self._v * t_s + 0.5 * self._a * t_s * t_s, self._v + self._a * t_s, self._a


def test_an_event_rises_smoothly_holds_and_falls() -> None:
    """A smooth step has half its height at half its time and 5/32 at a quarter."""
    creep = Creep(Steady(), LEVEL, 1, [CreepEvent(10.0, 14.0, 0.2, 1.0)], None)
    assert [creep.at("o", t) for t in (9.9, 10.0, 10.25, 10.5, 11.0, 12.0, 13.5, 14.0, 15.0)] == pytest.approx(
        [0.0, 0.0, 0.2 * 5.0 / 32.0, 0.1, 0.2, 0.2, 0.1, 0.0, 0.0]
    )


def test_an_event_shorter_than_its_ramps_reaches_its_ratio_in_its_middle() -> None:
    assert CreepEvent(0.0, 1.0, -0.3, 5.0).at(0.5) == pytest.approx(-0.3)


def test_events_of_one_unit_add_up_to_at_most_a_lock() -> None:
    creep = Creep(Steady(), LEVEL, 1, [CreepEvent(0.0, 9.0, -0.7, 1.0, ("a",)), CreepEvent(0.0, 9.0, -0.5, 1.0)], None)
    assert creep.at("a", 5.0) == -1.0
    assert creep.at("b", 5.0) == pytest.approx(-0.5)


def test_wheels_grip_while_the_demand_is_below_the_adhesion() -> None:
    """0.98 m/s² of 0.15 g on two thirds of the weight, 0.986 m/s², is just not too much."""
    dry = Adhesion(dry=(0.15, 0.15), poor_part=0.0, driven_part=0.67)
    assert Creep(Steady(a=0.98), LEVEL, 1, [], dry).at("o", 5.0) == 0.0
    assert Creep(Steady(a=-0.98), LEVEL, 1, [], dry).at("o", 5.0) == 0.0


@pytest.mark.parametrize(("a", "sign"), [(1.0, 1.0), (-1.0, -1.0)])
def test_creep_grows_with_the_excess_in_the_direction_of_the_force(a: float, sign: float) -> None:
    wet = Adhesion(dry=(0.1, 0.1), poor_part=0.0, driven_part=0.5, creep_per_excess=0.1, largest_creep=0.5)
    expected = 0.1 * (1.0 / (0.1 * GRAVITY_MPS2 * 0.5) - 1.0)
    assert Creep(Steady(a=a), LEVEL, 1, [], wet).at("o", 5.0) == pytest.approx(sign * expected)
    assert Creep(Steady(a=10.0 * a), LEVEL, 1, [], wet).at("o", 1.0) == pytest.approx(sign * min(0.5, 0.1 * 19.394))


def test_holding_speed_uphill_demands_traction() -> None:
    hill = Line("l", 20000.0, (), gradient=((0.0, 0.05),))
    slippery = Adhesion(dry=(0.04, 0.04), poor_part=0.0, driven_part=1.0, creep_per_excess=0.4)
    assert Creep(Steady(), hill, 1, [], slippery).at("o", 5.0) == pytest.approx(0.4 * (0.05 / 0.04 - 1.0))


def test_a_unit_on_a_trailing_axle_does_not_creep() -> None:
    slippery = Adhesion(dry=(0.01, 0.01), poor_part=0.0, units=("driven",))
    creep = Creep(Steady(a=1.0), LEVEL, 1, [], slippery)
    assert creep.at("driven", 5.0) > 0.0
    assert creep.at("trailing", 5.0) == 0.0


def test_the_share_of_poor_patches_is_as_configured() -> None:
    """Of 2000 patches a tenth is poor: 200 with a standard error of 13.4."""
    adhesion = Adhesion(poor_part=0.1, patch_m=10.0)
    creep = Creep(Steady(), LEVEL, 7, [], adhesion)
    middles = [10.0 * i + 4.0 for i in range(2000)]
    frictions = [creep.friction(s) for s in middles]
    poor = [f for f in frictions if f < 0.1]
    assert abs(len(poor) - 200) < 4.0 * 13.4
    assert min(poor) >= 0.03
    assert max(poor) <= 0.08
    assert min(f for f in frictions if f >= 0.1) >= 0.15
    assert max(frictions) <= 0.30
    again = Creep(Steady(), LEVEL, 7, [], adhesion)
    assert [again.friction(s) for s in reversed(middles)] == frictions[::-1]
    assert [Creep(Steady(), LEVEL, 8, [], adhesion).friction(s) for s in middles[:20]] != frictions[:20]


def test_friction_has_no_jumps() -> None:
    """From 0.3 to 0.03 within 8 m: 1 cm further it differs by less than 0.0004."""
    creep = Creep(Steady(), LEVEL, 3, [], Adhesion())
    along = np.arange(0.0, 500.0, 0.01)
    frictions = np.array([creep.friction(float(s)) for s in along])
    assert float(np.max(np.abs(np.diff(frictions)))) < 0.27 / 8.0 * 0.0101


def test_a_world_without_adhesion_has_no_friction() -> None:
    with pytest.raises(ValueError, match="adhesion"):
        Creep(Steady(), LEVEL, 1, [], None).friction(5.0)


def test_a_world_file_s_creep_is_built_as_written() -> None:
    content = {"events": [{"from_s": 1.0, "to_s": 3.0, "ratio": -1.0, "units": ["a"]}], "adhesion": {"poor_part": 0.0}}
    creep = CreepFile.model_validate(content).build(Steady(), LEVEL, 1)
    assert (creep.at("a", 2.0), creep.at("b", 2.0)) == (-1.0, 0.0)
    assert min(creep.friction(float(s)) for s in range(0, 2000, 7)) >= 0.15


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"events": [{"from_s": 3.0, "to_s": 3.0, "ratio": 0.1}]}, "must come after"),
        ({"events": [{"from_s": 3.0, "to_s": 4.0, "ratio": -1.1}]}, "greater than or equal to -1"),
        ({"adhesion": {"dry": [0.3, 0.2]}}, "lower friction"),
        ({"adhesion": {"wet": 0.1}}, "Extra"),
    ],
)
def test_a_mistake_in_creep_is_reported(content: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        CreepFile.model_validate(content)


def test_a_creep_event_of_an_unknown_unit_is_a_mistake() -> None:
    event = {"from_s": 1.0, "to_s": 3.0, "ratio": 0.1, "units": ["nobody"]}
    with pytest.raises(ConfigError, match=r"world\.creep\.events\.0\.units: nobody is not a unit"):
        load_train(TRAINS / "maglev.yaml", {"world": {"creep": {"events": [event]}}})
    with pytest.raises(ConfigError, match=r"world\.creep\.adhesion\.units: nobody is not a unit"):
        load_train(TRAINS / "maglev.yaml", {"world": {"creep": {"adhesion": {"units": ["loop", "nobody"]}}}})
    train = load_train(TRAINS / "maglev.yaml", {"world": {"creep": {"events": [{**event, "units": ["loop"]}]}}})
    world = train.world(10.0)
    assert world.creep is not None
    assert world.creep.at("loop", 2.0) == pytest.approx(0.1)
