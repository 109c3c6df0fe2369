"""`milepost evaluate --all` as somebody types it, on scenarios of two seconds; and what makes a scenario file wrong."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import psutil
import pytest
from ending import end
from harness import MAGLEV, ROOT

from milepost.config.yaml_files import ConfigError
from milepost.evaluation.campaign import find
from milepost.evaluation.plan import make_plan
from milepost.evaluation.pool import Task, run_tasks

pytestmark = pytest.mark.long

TINY: dict[str, Any] = {
    "scenario": "tiny",
    "about": "Two seconds.",
    "train": str(MAGLEV),
    "duration_s": 2.0,
    "seed": 4,
    "compare": ["fused", "centralised"],
    "estimators": {"deaf": {"rule": "federated", "change": {"units": {"loop": {"withhold_s": [[0.0, 9.0]]}}}}},
    "variants": {
        "radar_fails": {"change": {"units": {"radar": {"withhold_s": [[0.0, 9.0]]}}}, "estimators": [], "compare": ["fused"]}
    },
    "windows": {"late": [[1.0, 2.0]]},
    "scores": {"refresh_hz": None, "late_max_m": {"score": "position_max_m", "within": "late"}, "outside_interval": {}},
    "claims": [
        {"key": "late_max_m", "source": "B", "says": "< 10 m", "at_most": 10.0, "of": "worst", "method": "deaf"},
        {"key": "refresh_hz", "source": "A", "says": "1 kHz", "at_least": 1000.0, "why": "Epochs are 20 ms < apart."},
    ],
}
ABSENT = {"scenario": "absent", "train": str(MAGLEV), "duration_s": 1.0, "needs": ["no-such-recording.csv"]}


def evaluate(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "milepost", "evaluate", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def written(folder: Path, **scenarios: dict[str, Any]) -> Path:
    folder.mkdir(exist_ok=True)
    for name, fields in scenarios.items():
        (folder / f"{name}.yaml").write_text(json.dumps(fields), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("scenarios"), tiny=TINY, absent=ABSENT)


@pytest.fixture(scope="module")
def reported(folder: Path) -> tuple[subprocess.CompletedProcess[str], Path]:
    pytest.importorskip("matplotlib")
    report = folder / "report"
    return evaluate("--all", folder, "--runs", 2, "--jobs", 2, "--report", report), report


class Tables(HTMLParser):
    """The rows of a page's tables, as the texts of their cells; and the pictures it shows."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.pictures: list[str] = []
        self._open = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self._open = True
        elif tag == "img":
            self.pictures.append(str(dict(attrs)["src"]))

    def handle_endtag(self, tag: str) -> None:
        self._open = self._open and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._open:
            self.rows[-1][-1] += data


def test_the_page_has_a_row_for_each_claim_with_its_reason(reported):
    done, report = reported
    assert done.returncode == 0, done.stderr
    tables = Tables((report / "index.html").read_text(encoding="utf-8"))
    heading, missed, why, met = tables.rows[:4]
    assert heading[3:8] == ["its claim", "its method here", "Milepost here", "optimum here", "target"]
    assert (missed[0], missed[3], missed[-1]) == ("A", "1 kHz", "NO")
    assert why[1] == "Not met: Epochs are 20 ms < apart."
    assert (met[0], met[3], met[-1]) == ("B", "< 10 m", "yes")
    assert [cell == "-" for cell in met[4:7]] == [False, False, False]


def test_every_picture_on_the_page_is_there(reported):
    _, report = reported
    tables = Tables((report / "index.html").read_text(encoding="utf-8"))
    assert "tiny.errors.png" in tables.pictures
    assert "tiny.radar_fails.errors.png" in tables.pictures
    for name in tables.pictures:
        assert (report / name).read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_a_scenario_whose_recording_is_absent_is_skipped_and_said_to_be(reported):
    done, report = reported
    assert done.stderr.startswith("skipped absent: ")
    assert "no-such-recording.csv does not exist" in done.stderr
    assert "absent" in json.loads((report / "results.json").read_text(encoding="utf-8"))["skipped"]


def test_the_printed_table_is_the_pages(reported):
    done, _ = reported
    lines = done.stdout.splitlines()
    assert [line.split()[-1] for line in lines if line.startswith(("A ", "B "))] == ["NO", "yes"]
    assert "not met: Epochs are 20 ms < apart." in done.stdout


def test_the_results_do_not_depend_on_how_many_processes_made_them(folder, reported):
    done = evaluate("--all", folder, "--runs", 2, "--jobs", 1, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((reported[1] / "results.json").read_text(encoding="utf-8"))


def test_the_results_have_every_estimator_and_variant_with_medians_and_the_worst(reported):
    tiny = json.loads((reported[1] / "results.json").read_text(encoding="utf-8"))["scenarios"]["tiny"]
    assert (tiny["runs"], tiny["seed"]) == (2, 4)
    assert list(tiny["estimators"]) == ["fused", "deaf", "centralised"]
    assert list(tiny["variants"]["radar_fails"]["estimators"]) == ["fused"]
    fused = tiny["estimators"]["fused"]
    assert fused["refresh_hz"] == pytest.approx(50.0, rel=0.01)
    assert fused["late_max_m"] <= fused["position_max_m"] <= fused["worst"]["position_max_m"]
    assert "refresh_hz" not in tiny["estimators"]["centralised"]


def test_a_change_reaches_the_nodes(tmp_path):
    """A unit that a variant or an estimator silences is not among the sensors that its states say are in use."""
    path = written(tmp_path, tiny=TINY) / "tiny.yaml"
    traces = run_tasks([Task(path, 4, 6.0, keep=True)], 1, lambda done_s: None)[0].traces
    assert set(traces[""]["fused"].shares) == {"radar", "loop"}
    assert set(traces[""]["deaf"].shares) == {"radar"}
    assert set(traces["radar_fails"]["fused"].shares) == {"loop"}


def test_a_target_missed_without_a_reason_is_exit_code_1(tmp_path):
    claim = {"key": "position_max_m", "source": "A", "says": "-", "at_most": 1e-9}
    folder = written(tmp_path, tiny={"scenario": "t", "train": str(MAGLEV), "duration_s": 1.0, "claims": [claim]})
    assert evaluate("--all", folder, "--runs", 1).returncode == 1


def test_only_those_named_are_run_and_a_name_that_is_none_is_refused(folder):
    done = evaluate("--all", folder, "--only", "absent")
    assert done.returncode == 0
    assert "tiny" not in done.stdout
    refused = evaluate("--all", folder, "--only", "tinny")
    assert (refused.returncode, len(refused.stderr.splitlines())) == (2, 1)
    assert "no scenario has the name tinny" in refused.stderr


def at_work(children: list[psutil.Process], worked_s: float) -> bool:
    """Whether all children are there, and two of them have had so much of the processor."""
    return len(children) == 4 and sum(child.cpu_times().user >= worked_s for child in children) >= 2


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_an_evaluation_that_is_ended(folder, how):
    """Ctrl-C goes to all of them, a kill to the first alone; neither leaves a traceback."""
    command = [sys.executable, "-m", "milepost", "evaluate", folder / "tiny.yaml", "--runs", "500", "--jobs", "2"]
    running = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        # the workers are there: a manager, two of them, and who looks after their resources. A kill waits until they work: one
        # that has just been started cannot even read what it is for, and says so
        while not at_work(psutil.Process(running.pid).children(), 0.0 if how == signal.SIGINT else 2.0):
            with pytest.raises(subprocess.TimeoutExpired):
                running.wait(timeout=0.05)
        end(running, how)
    finally:
        running.kill()


def test_every_scenario_of_ours_can_be_evaluated_or_says_what_is_missing():
    plans, skipped = find(ROOT / "deploy/scenarios", [])
    names = [plan.scenario.scenario for plan in plans] + [each.scenario for each in skipped]
    assert len(names) == len(list((ROOT / "deploy/scenarios").glob("*.yaml")))
    assert len(set(names)) == len(names)
    assert all(plan.scenario.claims or plan.scenario.scores for plan in plans)


def test_a_mistake_that_a_worker_finds_is_still_one_line(tmp_path):
    """That a train begins beyond its line's end shows only when it runs."""
    change = {"world": {"motion": {"profile": [[0.0, 20.0]], "start_m": 1e6}}}
    path = written(tmp_path, tiny={"scenario": "t", "train": str(MAGLEV), "duration_s": 1.0, "change": change}) / "tiny.yaml"
    with pytest.raises(ConfigError) as here:
        run_tasks([Task(path, 1, 2.0)], 1, lambda done_s: None)
    with pytest.raises(ConfigError) as elsewhere:
        run_tasks([Task(path, 1, 2.0), Task(path, 2, 2.0)], 2, lambda done_s: None)
    assert str(elsewhere.value) == str(here.value)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"scores": {"positon_max_m": None}}, "scores.positon_max_m: must be one of position_mean_m"),
        ({"scores": {"refresh_hz": {"within": "nowhere"}}}, "scores.refresh_hz.within: must be one of the windows"),
        ({"scores": {"refresh_hz": {"within": [1]}}}, "scores.refresh_hz.within: must be one of the windows"),
        (
            {"scores": {"refresh_hz": {"estimator": {}}}},
            "scores.refresh_hz.estimator: must be one of the scenario's estimators",
        ),
        ({"scores": {"diameter_error_percent_at_m": {"unit": "radar", "at_m": [1.0]}}}, ".unit: radar is no odometer of"),
        ({"estimators": {"centralised": {}}}, "estimators.centralised: the name of a built-in estimator"),
        ({"scores": {"refresh_hz": {"unit": "radar"}}}, "scores.refresh_hz.unit: unknown key"),
        ({"scores": {"refresh_hz": {"within": "w"}}, "windows": {"w": "creep"}}, "the wheels of this world do not creep"),
        ({"windows": {"late": [[2.0, 1.0]]}}, "windows.late.0"),
        ({"compare": ["best"]}, "compare.0"),
        ({"estimators": {"a": {"change": {"units": {"radar": {"filter": "magic"}}}}}}, "estimators.a: "),
        ({"variants": {"v": {"change": {"fusion": {"rule": "magic"}}}}}, "variants.v.change: "),
        ({"variants": {"v": {"estimators": ["nobody"]}}}, "variants.v.estimators: nobody is not among"),
        ({"claims": [{**TINY["claims"][0], "key": "distance"}]}, "claims.0.key: distance is neither"),
        ({"claims": [{**TINY["claims"][0], "ours": "nobody"}]}, "claims.0.ours: nobody is not among"),
        ({"claims": [{**TINY["claims"][0], "variant": "v"}]}, "claims.0.variant: v is not among"),
        ({"claims": [{**TINY["claims"][0], "at_least": 1.0}]}, "claims.0: either at_most or at_least is required, not both"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_a_mistake_in_a_scenario_names_file_and_field(tmp_path, fields, said):
    path = written(tmp_path, tiny={**TINY, **fields}) / "tiny.yaml"
    with pytest.raises(ConfigError) as refused:
        make_plan(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert said in str(refused.value)
