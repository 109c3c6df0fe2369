"""The centralised filter where wheels slip: it counts the same readings as the fuser."""

from __future__ import annotations

from dataclasses import replace

import pytest
from harness import ROOT

from milepost.evaluation.plan import make_plan
from milepost.evaluation.scenario_run import Run, run_plan

SOURCE_D = ROOT / "deploy/scenarios/odometer-radar.yaml"
# past a spin at 58 s and a slide at 70 s, of all wheels at once
UNTIL_S = 80.0


@pytest.fixture(scope="module")
def slipped() -> Run:
    """Source D's metro train without its comparators, on a seed on which other verdicts led the two 0.5 σ apart."""
    plan = make_plan(SOURCE_D, 2)
    scenario = plan.scenario.model_copy(update={"duration_s": UNTIL_S})
    case = replace(plan.cases[0], comparators={})
    return run_plan(replace(plan, scenario=scenario, cases=(case,)), None, lambda done_s: None)


def test_fused_and_centralised_agree_through_spin_and_slide(slipped):
    figures = slipped.result["estimators"]
    assert slipped.result["fused_minus_centralised_max_sigma"] < 1e-6
    assert figures["centralised"]["nees_mean"] == pytest.approx(figures["fused"]["nees_mean"], rel=1e-6)
