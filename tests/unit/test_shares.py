"""How information is shared out: fixed, by speed as in source B, by accuracy; always to one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples import T0
from milepost.estimation.estimator import Prior
from milepost.estimation.layout import COMMON, Layout
from milepost.estimation.observation import Observation
from milepost.fusion.shares import FixedShares, SharesByAccuracy, SharesBySpeed, SpeedRow
from milepost.nodes.fuser import FuserNode
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.roster import Roster
from milepost.nodes.unit_record import UnitRow
from milepost.track.line import Line
from milepost_schemas import Estimate, FusedState, Gaussian
from milepost_schemas.estimate import LinearObservation

S = 1_000_000_000
UNITS = ("imu", "gnss", "radar")
PATENT = SharesBySpeed(
    (
        SpeedRow(50.0 / 3.6, {"imu": 0.6, "gnss": 0.3, "radar": 0.1}),
        SpeedRow(150.0 / 3.6, {"imu": 0.5, "gnss": 0.4, "radar": 0.1}),
        SpeedRow(math.inf, {"imu": 0.4, "gnss": 0.4, "radar": 0.2}),
    )
)


@pytest.mark.parametrize(
    ("kmh", "expected"),
    [(0.0, 0.6), (49.9, 0.6), (50.0, 0.5), (149.9, 0.5), (150.0, 0.4), (400.0, 0.4), (-60.0, 0.5)],
)
def test_the_patents_table_is_read_at_its_three_ranges_whichever_way_the_train_goes(kmh: float, expected: float) -> None:
    assert PATENT.at(UNITS, kmh / 3.6, {})["imu"] == pytest.approx(expected)


def test_a_failed_devices_share_goes_to_the_others_in_proportion() -> None:
    assert PATENT.at(("imu", "radar"), 100.0 / 3.6, {}) == pytest.approx({"imu": 5.0 / 6.0, "radar": 1.0 / 6.0})


def test_twice_the_information_gets_twice_the_share() -> None:
    assert SharesByAccuracy().at(("a", "b"), 0.0, {"a": 2.0, "b": 1.0}) == pytest.approx({"a": 2.0 / 3.0, "b": 1.0 / 3.0})


@given(
    st.lists(st.sampled_from(UNITS), unique=True, min_size=1),
    st.floats(-150.0, 150.0),
    st.dictionaries(st.sampled_from(UNITS), st.floats(0.0, 1e6)),
)
def test_shares_sum_to_one_over_the_reporting_units(reporting: list[str], speed: float, information: dict[str, float]) -> None:
    for shares in (FixedShares({"imu": 0.6, "gnss": 0.4}), PATENT, SharesByAccuracy()):
        found = shares.at(reporting, speed, information)
        assert set(found) == set(reporting)
        assert sum(found.values()) == pytest.approx(1.0)


def observation(unit: str, at_ns: int, row: tuple[float, ...], variance: float) -> Observation:
    return Observation(at_ns, 0, 0, "i", 0, unit, row, 0.0, variance)


def saw(known: Roster, o: Observation) -> None:
    """A reading that counts came."""
    known.arrived(o.unit, o.measured_at_ns, o.measured_at_ns)
    known.counted(o.unit, o.measured_at_ns)
    known.informed(o.unit, o)


def test_the_roster_sums_each_units_information_over_the_last_second() -> None:
    """J = h P hᵀ/R: gnss 2 x 4 m² / 1 m² = 8, radar 4 x 0.25 (m/s)² / 0.5 (m/s)² = 2; the radar's old one is forgotten."""
    known = Roster([UnitRow("gnss", 0, S, True), UnitRow("radar", 1, S, True)], SharesByAccuracy(), 0)
    saw(known, observation("radar", 8 * S, (0.0, 1.0, 0.0), 1e-6))
    for k in range(4):
        saw(known, observation("radar", 10 * S + k, (0.0, 1.0, 0.0), 0.5))
    for k in range(2):
        saw(known, observation("gnss", 10 * S + k, (1.0, 0.0, 0.0, 1.0), 1.0))
    at = 10 * S + S // 2
    presence = known.at(at, True, {}, 20.0, (4.0, 0.25, 0.01))
    assert presence.shares == pytest.approx({"gnss": 0.8, "radar": 0.2})


def test_a_slow_units_information_is_the_same_before_and_after_its_reading() -> None:
    """One fix in 2 s and two speeds a second: J = 4 m²/1 m² in 2 s against 2 · 0.25/0.25 in one: as much a second."""
    rows = [UnitRow("gnss", 0, 2 * S, True), UnitRow("radar", 1, S // 2, True)]
    known = Roster(rows, SharesByAccuracy(), 0)
    for k in range(20):
        saw(known, observation("radar", k * S // 2, (0.0, 1.0, 0.0), 0.25))
    for k in range(5):
        saw(known, observation("gnss", 2 * k * S, (1.0, 0.0, 0.0), 1.0))
    for at in (8 * S + S // 4, 9 * S + S // 4):
        shares = known.at(at, True, {}, 20.0, (4.0, 0.25, 0.01)).shares
        assert shares == pytest.approx({"gnss": 0.5, "radar": 0.5})


def test_federated_settled_and_live_states_use_the_same_speed_for_shares() -> None:
    """Below 10 m/s the radar counts alone: at 20 m/s both do, and between 0 m and 10 m the train is at 5 m."""
    shares = SharesBySpeed((SpeedRow(10.0, {"radar": 1.0}), SpeedRow(math.inf, {"radar": 0.5, "loop": 0.5})))
    rows = [UnitRow("radar", 0, None, True), UnitRow("loop", 1, None, True)]
    prior = Prior(np.array([0.0, 20.0, 0.0]), np.ones(3))
    period = 20_000_000
    settings = FuserSettings("federated", period, 0, S, False, 1, shares, 5.0, 1e6, 1e-3, prior, Layout(), rows)
    fuser = FuserNode("t", "f", settings, Line("test-line", 1e4, ()))
    at = T0 // period * period
    for unit, position in (("radar", 0.0), ("loop", 10.0)):
        head = {"train": "t", "unit": unit, "instance": "i", "sequence": 0, "measured_at_ns": at, "published_at_ns": at}
        belief = Gaussian(states=list(COMMON), mean=[position, 20.0, 0.0], covariance=np.eye(3).tolist())
        said = {"sensor_instance": "s", "reading_sequence": 0, "measured_at_ns": at, "row": [0.0, 1.0, 0.0]}
        observation = LinearObservation(**said, value=20.0, variance=1.0)
        live = [o.message for o in fuser.step(Estimate(**head, belief=belief, observations=[observation]), at)]
    (settled,) = fuser.settled_states(None)
    assert [m.position_m for m in live if isinstance(m, FusedState)] == [settled.position_m] == [pytest.approx(5.0)]


def test_shares_are_even_before_the_first_state_and_follow_it_afterwards() -> None:
    """The sources' rule needs shares for its state: those of the epoch before, J = 8 to 2 as above."""
    known = Roster([UnitRow("gnss", 0, S, True), UnitRow("radar", 1, S, True)], SharesByAccuracy(), 0)
    for k in range(4):
        saw(known, observation("radar", 10 * S + k, (0.0, 1.0, 0.0), 0.5))
    for k in range(2):
        saw(known, observation("gnss", 10 * S + k, (1.0, 0.0, 0.0, 1.0), 1.0))
    at = 10 * S + S // 2
    assert known.at(at, True, {}).shares == pytest.approx({"gnss": 0.5, "radar": 0.5})
    assert known.at(at, True, {}, 20.0, (4.0, 0.25, 0.01)).shares == pytest.approx({"gnss": 0.8, "radar": 0.2})
