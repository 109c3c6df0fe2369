"""Claims judged on figures made by hand."""

from __future__ import annotations

from typing import Any

import pytest

from milepost.config.scenario_file import ScenarioFile
from milepost.evaluation.claims import JudgedClaim, SeedStatistics, judge
from milepost.evaluation.tables import claims_table, flat

CLAIM = {"key": "position_max_m", "source": "B", "says": "< 10 m", "at_most": 2.0}


def scenario(*claims: dict[str, Any]) -> ScenarioFile:
    return ScenarioFile.model_validate({"scenario": "s", "train": "maglev", "duration_s": 1.0, "claims": list(claims)})


def seed(ours: float, method: float = 8.0, optimum: float = 1.0) -> dict[str, Any]:
    figures = {"fused": ours, "federated": method, "centralised": optimum}
    estimators = {name: {"position_max_m": value, "refresh_hz": value, "map": {"30": value}} for name, value in figures.items()}
    return {"estimators": estimators, "withheld_max_m": ours, "variants": {"v": {"estimators": estimators}}}


def judged(claim: dict[str, Any], *seeds: dict[str, Any]) -> JudgedClaim:
    return judge(scenario(claim), seeds)[0]


def test_a_row_has_the_sources_method_ours_and_the_optimum():
    row = judged(CLAIM, seed(1.0, 7.0), seed(2.0, 9.0, 3.0), seed(1.5))
    assert (row.ours, row.method, row.optimum) == (SeedStatistics(1.5, 2.0), SeedStatistics(8.0, 9.0), SeedStatistics(1.0, 3.0))
    assert row.met


@pytest.mark.parametrize(
    ("changed", "met"),
    [
        ({}, True),  # median 1.5
        ({"of": "worst"}, False),  # worst 4
        ({"at_most": 1.4}, False),
        ({"at_most": 0.2, "over": "federated"}, True),  # 1.5/8
        ({"at_most": 0.2, "over": "federated", "of": "worst"}, False),  # 4/8
        ({"at_most": 2.54, "of": "pooled"}, True),  # √(19.25/3) = 2.533
        ({"at_most": 2.53, "of": "pooled"}, False),
        ({"key": "map.30"}, True),
        ({"key": "map.30", "variant": "v", "of": "worst"}, False),
        ({"key": "withheld_max_m", "method": None, "optimum": None}, True),
    ],
)
def test_a_target_is_held_against_the_median_or_the_worst(changed, met):
    assert judged({**CLAIM, **changed}, seed(1.0), seed(4.0), seed(1.5)).met is met


def test_pooled_figures_are_divided_as_wholes():
    claim = {**CLAIM, "of": "pooled", "over": "federated"}
    row = judged(claim, seed(3.0, 1.0), seed(4.0, 7.0))
    # √(9 + 16)/√(1 + 49), where the median of 3/1 and 4/7 is 1.79
    assert row.ours == SeedStatistics(pytest.approx(12.5 / 7.0), 3.0, pytest.approx(0.5**0.5))
    assert "0.707 (3)" in claims_table([row])


def test_where_more_is_better_the_worst_is_the_least():
    claim = {"key": "refresh_hz", "source": "B", "says": "50 Hz", "at_least": 50.0, "of": "worst"}
    row = judged(claim, seed(51.0), seed(49.0), seed(52.0))
    assert row.ours == SeedStatistics(51.0, 49.0)
    assert not row.met


def test_an_estimator_that_was_not_run_leaves_its_column_empty():
    assert judged({**CLAIM, "method": "plain"}, seed(1.0)).method is None


def test_a_figure_that_a_run_does_not_have_meets_nothing():
    row = judged({**CLAIM, "key": "map.40"}, seed(1.0))
    assert (row.met, row.ours) == (False, None)
    assert row.why == "fused has no figure map.40 on every seed"


def test_the_printed_table_says_why_a_target_is_not_met():
    table = claims_table([judged({**CLAIM, "at_most": 0.5, "why": "Nobody can."}, seed(1.0)), judged(CLAIM, seed(1.0))])
    lines = table.splitlines()
    assert lines[2].split()[-1] == "NO"
    assert lines[3].strip() == "not met: Nobody can."
    assert lines[4].split()[-1] == "yes"
    assert len(lines) == 5


def test_the_entries_of_a_map_or_a_list_are_named_as_claims_name_them():
    assert flat({"a": 1.0, "map": {"30": 2.0}, "list": [3.0, 4.0]}) == {"a": 1.0, "map.30": 2.0, "list.0": 3.0, "list.1": 4.0}


def test_a_figure_without_a_target_is_shown_and_not_judged():
    row = judged({"key": "position_max_m", "source": "B", "says": "-"}, seed(1.0), seed(4.0), seed(1.5))
    assert (row.ours, row.target, row.met) == (SeedStatistics(1.5, 4.0), "-", None)
    assert "not met" not in claims_table([row])
