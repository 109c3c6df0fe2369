"""The checks of published intervals as `milepost evaluate` computes, prints and reports them, on a short maglev run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from harness import MAGLEV, ROOT, at, on_its_line

from milepost.checks.requirements import CHECKS
from milepost.evaluation.campaign import Evaluated
from milepost.evaluation.claims import judge
from milepost.evaluation.plan import Plan, make_plan
from milepost.evaluation.scenario_run import Run, run_plan

EVERYWHERE = [name for name, check in CHECKS.items() if check.always]
# the first balise of the run lies 5 s ahead
SCENARIO: dict[str, Any] = {
    "scenario": "checked",
    "train": str(MAGLEV),
    "duration_s": 12.0,
    "seed": 5,
    "windows": {"node": [[8.0, 10.0]]},
    "scores": {"subset_041_position": None, "loc_ob_node_position": {"within": "node"}, "position_interval": None},
    "claims": [
        {"key": "subset_041_position.availability", "source": "SUBSET-041", "says": "5 m + 5 %", "at_least": 0.999},
        {"key": "position_interval.violations", "source": "SUBSET-041", "says": "-", "at_most": 0, "of": "worst"},
        {"key": "loc_ob_node_position.width_max_m", "source": "LOC-OB", "says": "±1 m", "at_most": 1.0},
        {"key": "subset_041_position.width_max_m", "source": "-", "says": "-", "at_most": 0.001, "why": "Nobody can."},
    ],
}


def written(folder: Path, **changed: Any) -> Path:
    path = folder / "checked.yaml"
    path.write_text(json.dumps({**SCENARIO, **changed}), encoding="utf-8")
    return path


def evaluate(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "milepost", "evaluate", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Run]:
    plan = make_plan(written(tmp_path_factory.mktemp("checks")))
    return plan, run_plan(plan, None, lambda done_s: None)


def test_every_estimator_that_publishes_an_interval_is_checked(checked: tuple[Plan, Run]) -> None:
    checks = checked[1].result["checks"]
    # the centralised filter publishes nothing
    assert list(checks) == ["fused", "federated"]
    assert all(list(found) == EVERYWHERE for found in checks.values())


def test_the_figures_are_those_of_the_published_states(checked: tuple[Plan, Run]) -> None:
    log, checks = checked[1].log, checked[1].result["checks"]["fused"]
    states = [state for ns, state in log.settled.items() if ns in log.truth]
    widths = sorted(state.position_max_m - state.position_min_m for state in states)
    assert checks["position_interval"]["epochs"] == len(states)
    assert checks["position_interval"]["width_max_m"] == pytest.approx(widths[-1])
    assert checks["position_interval"]["violations"] == 0
    passed = [state for state in states if state.last_balise is not None]
    assert 0 < len(passed) < len(states)
    assert checks["subset_041_position"]["epochs"] == len(passed)
    reach = max(max(s.position_max_m - s.position_m, s.position_m - s.position_min_m) for s in passed)
    assert checks["subset_041_position"]["width_max_m"] == pytest.approx(reach)


def test_the_first_balise_moves_the_rear_at_a_bound(checked: tuple[Plan, Run]) -> None:
    log, rear = checked[1].log, checked[1].result["checks"]["fused"]["oc_7244_rear"]
    states = [state for ns, state in sorted(log.settled.items()) if ns in log.truth]
    first = next(k for k, state in enumerate(states) if state.last_balise is not None)
    before, after = states[first - 1], states[first]
    travelled = 0.5 * (before.speed_mps + after.speed_mps) * (after.measured_at_ns - before.measured_at_ns) / 1e9
    assert after.measured_at_ns > at(1.0)
    assert rear["worst_m"] == pytest.approx(after.position_min_m - before.position_min_m - travelled)


def test_a_requested_check_is_limited_to_its_window(checked: tuple[Plan, Run]) -> None:
    figures = checked[1].result["estimators"]["fused"]
    assert figures["subset_041_position"] == checked[1].result["checks"]["fused"]["subset_041_position"]
    assert figures["loc_ob_node_position"]["epochs"] == 100


def test_claims_bound_the_figures_of_checks(checked: tuple[Plan, Run]) -> None:
    plan, run = checked
    rows = judge(plan.scenario, [run.result])
    assert [row.met for row in rows] == [True, True, True, False]
    assert rows[0].ours is not None
    assert rows[0].ours.median == run.result["checks"]["fused"]["subset_041_position"]["availability"]


def test_over_many_seeds_the_least_availability_is_the_worst(checked: tuple[Plan, Run]) -> None:
    plan, run = checked
    other = json.loads(json.dumps(run.result))
    for figures in (other["checks"]["fused"], other["estimators"]["fused"]):
        figures["subset_041_position"]["availability"] = 0.5
    out = Evaluated(plan, [run.result, other], [], None).figures
    assert out["checks"]["fused"]["subset_041_position"]["worst"]["availability"] == 0.5
    assert out["estimators"]["fused"]["worst"]["subset_041_position"]["availability"] == 0.5


def test_json_has_every_check_with_units_in_names(tmp_path: Path, checked: tuple[Plan, Run]) -> None:
    done = evaluate(written(tmp_path), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["checks"] == checked[1].result["checks"]
    units = {"m": "_m", "mps": "_mps", "s": "_s"}
    for name, figures in checked[1].result["checks"]["fused"].items():
        without = {"epochs", "violations", "violations_share", "availability"}
        assert all(key.endswith(units[CHECKS[name].unit]) for key in figures if key not in without)


def test_the_table_of_checks_stands_after_the_figures(tmp_path: Path) -> None:
    lines = evaluate(written(tmp_path, scores={}, claims=[], compare=["fused"])).stdout.splitlines()
    start = lines.index("checks of fused")
    assert [line.split()[0] for line in lines[start + 2 :]] == EVERYWHERE
    assert max(map(len, lines[start:])) <= 100


def test_the_report_shows_every_check(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    done = evaluate(written(tmp_path, scores={}, claims=[], compare=["fused"]), "--report", tmp_path / "report")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "report/index.html").read_text(encoding="utf-8")
    assert "Checks of fused" in page
    assert all(f"<td>{name}</td>" in page for name in EVERYWHERE)
    results = json.loads((tmp_path / "report/results.json").read_text(encoding="utf-8"))
    assert set(results["scenarios"]["checked"]["checks"]["fused"]) == set(EVERYWHERE)


def test_a_run_that_ends_before_its_time_says_when(tmp_path: Path) -> None:
    """From 100 m at 20 m/s, 50 m before the end of a line of 400 m are reached after 12.5 s."""
    balises = {"every_m": 100.0, "from_m": 150.0, "location_accuracy_m": 0.05}
    line = {"line": "short", "length_m": 400.0, "map_accuracy_m": 0.02, "balises": balises}
    train = yaml.safe_load(MAGLEV.read_text(encoding="utf-8"))
    train["prior"] |= {"position_m": 100.0, "speed_mps": 20.0}
    train["world"]["motion"] |= {"profile": [[0.0, 20.0]], "start_m": 100.0}
    on_its_line(tmp_path, line, train)
    path = written(tmp_path, train="train.yaml", duration_s=60.0, windows={}, scores={}, claims=[])
    (said,) = [line for line in evaluate(path).stdout.splitlines() if line.startswith("ended")]
    assert said == "ended after 12.5 s, where the train was 50 m before the end of its line, or its recordings ended"
    assert json.loads(evaluate(path, "--json").stdout)["ended_s"] == pytest.approx(12.5)
