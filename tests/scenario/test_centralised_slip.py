"""The centralised filter where wheels slip: told which unit the fuser excluded and when, it comes to the same states.

The reference knows nothing of hypotheses and tests. It is plain Kalman filters over all states, one for each set of units
that was ever excluded, and follows the one that the fuser's decisions name.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from harness import ROOT

from milepost.config.fusion_settings import full_layout, fuser_settings, prior
from milepost.config.train import Train, load_train
from milepost.estimation.centralised import Reading, centralised
from milepost.estimation.gaussian import stretched
from milepost.estimation.kalman import predict, update
from milepost.estimation.layout import Array
from milepost.estimation.motion import full_process_noise, full_transition
from milepost.estimation.time_units import S_PER_NS
from milepost.evaluation.run_log import RunLog
from milepost.fusion.information_rule import InformationFusion
from milepost.fusion.rule import Fused
from milepost.nodes.observations import of_estimate, of_fix, whole_readings
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.sensors.observed import Belief
from milepost_schemas import AbsoluteFix, Estimate, FusedState
from milepost_schemas.state import SAYS_NOTHING

METRO = ROOT / "deploy/trains/metro.yaml"
# past a spin at 58 s and a slide at 70 s, of all wheels at once, and the readmissions after each
UNTIL_S, SEED = 82.0, 2
# with a period this short, no unit has two readings between two epochs
PERIOD_MS = 50
NOT_BY_THE_BANK = {*SAYS_NOTHING, "refused"}
Units = frozenset[str]


class Decision(NamedTuple):
    """With the reading of `unit` at `at_ns`, the set of excluded units becomes another; `recalls`: a wheel keeps its scale."""

    at_ns: int
    unit: str
    excluded: Units
    recalls: bool


@dataclass
class Journey:
    """A simulated train's readings, its settled states, and the fuser's belief and decisions at the same epochs."""

    train: Train
    log: RunLog
    fused: dict[int, Fused] = field(default_factory=dict)
    decisions: list[Decision] = field(default_factory=list)


def left_out(fused: Fused) -> Units:
    return frozenset(unit for unit, verdict in fused.verdicts.items() if verdict.excluded is not None)


def decided(fused: dict[int, Fused]) -> list[Decision]:
    """The fuser's decisions, from what it says of its units at each epoch."""
    out = []
    for before, after in pairwise(fused.values()):
        changed: dict[tuple[int, str], tuple[Units, bool]] = {}
        now = left_out(before)
        for unit in left_out(after) ^ now:
            why = after.verdicts[unit].excluded
            if why is None:
                heard_ns = after.verdicts[unit].heard_ns
                assert heard_ns is not None
                changed[heard_ns, unit] = frozenset((unit,)), False
            else:
                units, _ = changed.get((why.at_ns, why.found_by), (frozenset(), False))
                changed[why.at_ns, why.found_by] = units | {unit}, why.sudden and not before.doubted
        for (at_ns, unit), (units, recalls) in sorted(changed.items()):
            now = now ^ units
            out.append(Decision(at_ns, unit, now, recalls))
    return out


@pytest.fixture(scope="module")
def journey() -> Journey:
    train = load_train(METRO, {"fusion": {"period_ms": PERIOD_MS}}, SEED)
    settings, messages = fuser_settings(train), []
    log = RunLog(train, lambda output, now_ns: messages.append(output.message))
    simulate(train, UNTIL_S, log.tap, log.keep)
    # the same estimates and fixes into the rule by itself, for what it says of its units
    forever = round(1e9 * UNTIL_S)
    rule = InformationFusion(
        settings.layout, settings.jerk_psd, settings.prior, forever, True, settings.judges, settings.doubts
    )
    orders = {row.unit: row.order for row in settings.units}
    end_ns = OFFLINE_START_NS + forever
    for message in messages:
        if isinstance(message, AbsoluteFix):
            assert rule.take_fix(of_fix(message, orders[message.reader]), end_ns) is None
        elif isinstance(message, Estimate):
            order, judge = orders[message.unit], settings.judges.get(message.unit)
            rows = of_estimate(message, order)
            for o in rows if judge is None else whole_readings(message, order, judge.message, rows):
                assert rule.estimator.insert(o, end_ns) is None
    out = Journey(train, log)
    for at in log.settled:
        fused = rule.state_at(at, {})
        assert fused is not None
        out.fused[at] = fused
    out.decisions = decided(out.fused)
    return out


def pure_readings(journey: Journey) -> list[Reading]:
    """All readings and fixes in order of time, each observed by its sensor's pure model."""

    def observed(order: int, message: Any) -> Reading:
        if isinstance(message, AbsoluteFix):
            o = of_fix(message, order)
            rows = [(o.row, o.value, o.variance)]
            return Reading(o.measured_at_ns, order, o.sequence, o.instance, o.unit, lambda mean, covariance: rows)
        observe = journey.train.sensors[message.unit].observe
        head = (message.measured_at_ns, order, message.sequence, message.instance)
        return Reading(*head, message.unit, lambda mean, covariance: observe(message, Belief(mean, covariance)))

    readings = [observed(*entry) for entry in journey.log.readings]
    return sorted(readings, key=lambda r: (r.measured_at_ns, r.order, r.sequence))


class Reference:
    """Plain filters over all states, for each set of units that was ever excluded, and which of them is followed."""

    def __init__(self, train: Train, decisions: list[Decision]) -> None:
        self.layout, self._q = full_layout(train), train.file.motion_model.jerk_psd_m2ps5
        start = prior(train)
        belief = self.layout.prior(start.mean, start.std)
        self._sets: set[Units] = {d.excluded for d in decisions} | {frozenset()}
        self._beliefs: dict[Units, tuple[Array, Array]] = dict.fromkeys(self._sets, belief)
        self.excluded: Units = frozenset()
        self._at_ns: int | None = None

    @property
    def belief(self) -> tuple[Array, Array]:
        return self._beliefs[self.excluded]

    def carry(self, at_ns: int) -> None:
        if self._at_ns is not None and at_ns > self._at_ns:
            dt_s = (at_ns - self._at_ns) * S_PER_NS
            F, Q = full_transition(dt_s, self.layout), full_process_noise(dt_s, self._q, self.layout)
            self._beliefs = {units: predict(x, P, F, Q) for units, (x, P) in self._beliefs.items()}
        self._at_ns = at_ns

    def take(self, reading: Reading) -> None:
        own, scale = list(self.layout.indices.get(reading.unit, (0, 1, 2))), self.layout.scales.get(reading.unit)
        for units, (x, P) in self._beliefs.items():
            if reading.unit not in units:
                for row, value, variance in reading.observe(x[own], P[np.ix_(own, own)]):
                    before = x
                    x, P = update(x, P, np.array(self.layout.lift(reading.unit, row)), value, variance)
                    if scale is not None:
                        P = stretched(before, x, P, scale)
                self._beliefs[units] = x, P

    def decide(self, decision: Decision, before: tuple[Array, Array]) -> None:
        """Follow the filter that the decision names; every other goes on from its own, or from the one that is followed."""
        old, gone, back = self._beliefs, decision.excluded - self.excluded, self.excluded - decision.excluded
        followed = old[decision.excluded | back]
        self._beliefs = {
            units: old.get(units | back, followed) if units >= decision.excluded else followed for units in self._sets
        }
        self.excluded = decision.excluded
        places = [p for unit in sorted(gone) if decision.recalls for p in self.layout.indices.get(unit, ())[3:]]
        for units, (x, P) in list(self._beliefs.items()):
            for p in places:
                x, P = x.copy(), P.copy()
                x[p], P[p, :], P[:, p] = before[0][p], 0.0, 0.0
                P[p, p] = 4.0 * before[1][p, p]
            self._beliefs[units] = x, P


def told(journey: Journey) -> dict[int, tuple[Array, Array]]:
    """The reference's belief at each epoch."""
    reference, out = Reference(journey.train, journey.decisions), {}
    readings, decisions = pure_readings(journey), list(journey.decisions)
    for epoch in journey.fused:
        while readings and readings[0].measured_at_ns <= epoch:
            reading = readings.pop(0)
            reference.carry(reading.measured_at_ns)
            before = reference.belief
            reference.take(reading)
            if decisions and (decisions[0].at_ns, decisions[0].unit) == (reading.measured_at_ns, reading.unit):
                reference.decide(decisions.pop(0), before)
        reference.carry(epoch)
        out[epoch] = reference.belief
    assert not decisions, "a decision belongs to no reading"
    return out


def in_sigmas(state: FusedState, x: Array, P: Array) -> float:
    apart = np.array([state.position_m, state.speed_mps, state.acceleration_mps2]) - x[:3]
    return float(np.max(np.abs(apart) / np.sqrt(np.diag(P)[:3])))


def test_both_wheels_are_excluded_and_readmitted_in_spin_and_slide(journey: Journey) -> None:
    both = {"odometer-1", "odometer-2"}
    assert [d.excluded for d in journey.decisions].count(frozenset(both)) == 2
    assert all(d.excluded <= both for d in journey.decisions)
    assert journey.decisions[-1].excluded == frozenset()


def test_settled_states_say_what_the_decisions_say(journey: Journey) -> None:
    for at, state in journey.log.settled.items():
        assert {e.unit for e in state.excluded if e.kind not in NOT_BY_THE_BANK} == left_out(journey.fused[at])


def test_until_the_first_exclusion_it_is_the_centralised_filter(journey: Journey) -> None:
    epochs = [at for at in journey.log.settled if at < journey.decisions[0].at_ns]
    start, q = prior(journey.train), journey.train.file.motion_model.jerk_psd_m2ps5
    optimum = centralised(pure_readings(journey), epochs, full_layout(journey.train), q, start)
    worst = max(in_sigmas(journey.log.settled[at], x, P) for at, x, P in optimum)
    assert len(epochs) > 1000
    assert worst < 1e-6


def test_fused_and_centralised_agree_through_spin_and_slide(journey: Journey) -> None:
    beliefs = told(journey)
    worst = max(in_sigmas(journey.log.settled[at], *belief) for at, belief in beliefs.items())
    assert worst < 1e-6


def test_the_comparison_would_notice_a_decision_that_it_is_not_told(journey: Journey) -> None:
    deaf = Journey(journey.train, journey.log, journey.fused, [])
    assert max(in_sigmas(journey.log.settled[at], *belief) for at, belief in told(deaf).items()) > 1.0
