"""The centralised filter where wheels slip: it takes the readings that the filters' judges let count, at their variances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness import ROOT

from milepost.evaluation.plan import make_plan
from milepost.evaluation.scenario_run import Run, run_plan

SOURCE_D = ROOT / "deploy/scenarios/odometer-radar.yaml"
# past a spin at 58 s and a slide at 70 s, of all wheels at once
UNTIL_S = 80.0


@pytest.fixture(scope="module")
def slipped() -> Run:
    """Source D's metro train without its comparators, on a seed on which verdicts of its own led the pass 0.5 σ away."""
    plan = make_plan(SOURCE_D, 2)
    scenario = plan.scenario.model_copy(update={"duration_s": UNTIL_S})
    case = replace(plan.cases[0], comparators={})
    return run_plan(replace(plan, scenario=scenario, cases=(case,)), None, lambda done_s: None)


def test_fused_and_centralised_agree_through_spin_and_slide(slipped):
    figures = slipped.result["estimators"]
    assert slipped.result["fused_minus_centralised_max_sigma"] < 0.3
    assert figures["centralised"]["nees_mean"] == pytest.approx(figures["fused"]["nees_mean"], rel=0.02)


def test_a_reading_of_a_slipping_wheel_does_not_count_in_the_centralised_pass(slipped):
    mean, covariance = np.array([1300.0, 22.2, 0.0, 0.05]), 1e-2 * np.eye(4)
    refused = counted = 0
    for reading in slipped.log.centralised_readings("odometer-1"):
        rows = list(reading.observe(mean, covariance))
        variance = slipped.log.verdict("odometer-1", reading.measured_at_ns)
        assert [row[2] for row in rows] == ([] if variance is None else [variance])
        refused += variance is None
        counted += variance is not None
    # two slips of six seconds each, at ten readings a second, and half a second until the wheel is believed again
    assert 110 < refused < 160
    assert counted > 600
