"""The scenario `gnss-ins-outage`, shortened: who may be better than whom, and where."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import yaml
from harness import ROOT

from milepost.evaluation.plan import make_plan
from milepost.evaluation.pool import Task, run_task

pytestmark = pytest.mark.long

SCENARIO = ROOT / "deploy/scenarios/gnss-ins-outage.yaml"
SEEDS = (1, 2)
BAD = {"plain", "milepost", "oracle"}
WHITE = {"plain_tuned", "milepost"}


def shortened() -> dict[str, Any]:
    fields = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    fields |= {"train": str(SCENARIO.parent / fields["train"]), "duration_s": 150.0, "compare": [], "claims": []}
    fields["change"] = {}
    fields["windows"] = {"good": [[20.0, 150.0]], "outage": [[20.0, 150.0]]}
    fields["estimators"] = {name: told for name, told in fields["estimators"].items() if name in BAD | WHITE}
    fields["variants"] = {"white_noise": {**fields["variants"]["white_noise"], "estimators": sorted(WHITE)}}
    return fields


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    path = tmp_path_factory.mktemp("gnss-ins") / "short.yaml"
    path.write_text(json.dumps(shortened()), encoding="utf-8")
    return [run_task(Task(path, seed, 0.0), lambda _: None).result for seed in SEEDS]


def pooled(conditions: list[dict[str, Any]], estimator: str, key: str) -> float:
    return float(np.sqrt(np.mean([c["estimators"][estimator][key] ** 2 for c in conditions])))


@pytest.mark.parametrize("key", ["position_std_m", "speed_std_mps"])
def test_with_varying_noise_milepost_is_better_than_the_data_sheet(results, key):
    oracle, ours, plain = (pooled(results, name, key) for name in ("oracle", "milepost", "plain"))
    assert oracle < ours < 0.6 * plain


def test_only_milepost_is_consistent_with_varying_noise(results):
    assert max(result["estimators"]["milepost"]["outside_interval"] for result in results) < 0.01
    assert min(result["estimators"]["plain"]["outside_interval"] for result in results) > 0.1


def test_with_known_white_noise_the_kalman_filter_is_best(results):
    twins = [result["variants"]["white_noise"] for result in results]
    for key in ("position_std_m", "speed_std_mps"):
        # the optimum errs least on average, not on each seed
        assert pooled(twins, "plain_tuned", key) < 1.05 * pooled(twins, "milepost", key)


def test_tuned_is_tuned_to_the_mean_variance_of_the_noise():
    case = make_plan(SCENARIO).cases[0]
    told = case.comparators["plain_tuned"].sensors["gnss"].options
    sky = case.train.sensors["gnss"].options.simulated
    least, most, outliers = sky.wandering.least_m, sky.wandering.most_m, sky.outliers
    # σ² is uniform in its logarithm, and an outlier's is κ² as large
    of_wandering = (most**2 - least**2) / (2.0 * np.log(most / least))
    mean = of_wandering * (1.0 + outliers.probability * (outliers.factor**2 - 1.0))
    assert told.position_std_m["single"] ** 2 == pytest.approx(mean, rel=1e-3)
    twin = make_plan(SCENARIO).cases[1].train.sensors["gnss"].options.simulated
    assert twin.wandering.least_m == twin.wandering.most_m == told.position_std_m["single"]
    assert twin.outliers.probability == 0.0
