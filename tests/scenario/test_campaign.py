"""`milepost campaign` as somebody types it, on runs of a few seconds."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest
from ending import end
from harness import ROOT

pytestmark = pytest.mark.long

TINY: dict[str, Any] = {
    "campaign": "tiny",
    "about": "A radar < a loop.",
    "runs": 2,
    "trains": {"maglev": {"train": "maglev", "duration_s": 6.0, "onset_s": 2.0}},
    "faults": [
        {"label": "bias +5 m/s", "kind": "bias", "options": {"size": 5.0}, "sensors": ["doppler_radar"]},
        {"label": "silent for 2 s", "kind": "drop_out", "for_s": 2.0, "units": ["loop"]},
    ],
}

# for campaigns of which only the way they end matters
BRIEF: dict[str, Any] = {"maglev": {"train": "maglev", "duration_s": 2.0, "onset_s": 1.0}}


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "milepost", "campaign", *map(str, arguments)]


def campaign(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def written(folder: Path, **fields: Any) -> Path:
    path = folder / "tiny.yaml"
    path.write_text(json.dumps({**TINY, **fields}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def reported(tiny: Path) -> tuple[subprocess.CompletedProcess[str], Path]:
    report = tiny.parent / "report"
    return campaign(tiny, "--json", "--jobs", 2, "--report", report), report


@pytest.fixture(scope="module")
def results(reported: tuple[subprocess.CompletedProcess[str], Path]) -> dict[str, Any]:
    done, _ = reported
    assert done.stderr == ""
    assert len(done.stdout.splitlines()) == 1
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_json_has_every_cell_with_units_in_the_names(results):
    assert (results["campaign"], results["seed"], results["runs_per_cell"]) == ("tiny", 1, 2)
    lying, silent = results["cells"]
    assert (lying["train"], lying["units"], lying["fault"], lying["runs"]) == ("maglev", ["radar"], "bias +5 m/s", 2)
    assert (silent["units"], silent["fault"]) == (["loop"], "silent for 2 s")
    assert lying["epochs"] == pytest.approx(2 * 4 * 50, abs=4)
    # a second of silence is late, and the loop is back with its next reading
    assert 0.9 <= silent["time_to_detect_p95_s"] <= 1.1
    assert (silent["detected_percent"], silent["readmitted_percent"]) == (100.0, 100.0)
    assert silent["time_to_recover_p95_s"] <= 0.1
    assert set(silent["statuses_percent"]) == {"normal", "degraded"}
    assert silent["violation_runs"] == 0
    assert lying["failed_runs"] == [] or lying["failed_runs"][0]["faults"][0]["kind"] == "bias"


def test_exit_code_1_says_that_a_truth_was_outside(results, reported, tmp_path):
    assert reported[0].returncode == int(results["violated_cells"] > 0)
    # a train that is told a wrong place, and comes to no balise: no fusion can hold the truth
    lost = {"train": "maglev", "duration_s": 4.0, "change": {"prior": {"position_m": 50.0}}}
    done = campaign(written(tmp_path, runs=1, faults=[], trains={"maglev": lost}), "--json")
    assert done.returncode == 1
    (cell,) = json.loads(done.stdout)["cells"]
    assert (cell["units"], cell["violation_runs"], cell["violation_epochs_percent"]) == ([], 1, 100.0)
    assert cell["failed_runs"][0]["seed"] == 1


def test_a_campaign_without_faults_has_rates_and_exit_code_0(tmp_path):
    honest = campaign(written(tmp_path, faults=[], runs=1), "--json")
    assert honest.returncode == 0
    (cell,) = json.loads(honest.stdout)["cells"]
    assert (cell["violation_runs"], cell["wrong_exclusions_per_h"], cell["detected_percent"]) == (0, 0.0, None)
    assert cell["subset_041_percent"] == 100.0


def test_one_process_and_no_file_give_the_same_figures(tiny, reported):
    assert campaign(tiny, "--json", "--jobs", 1).stdout == reported[0].stdout


def test_the_page_needs_no_other_file_and_maps_every_cell(results, reported):
    page = (reported[1] / "index.html").read_text(encoding="utf-8")
    assert json.loads((reported[1] / "results.json").read_text(encoding="utf-8")) == results
    assert not {"src=", "href=", "url("} & set(page.split())
    assert "<img" not in page
    assert "<link" not in page
    assert "A radar &lt; a loop." in page
    assert page.count('<th scope="row">') == 2
    assert page.count('<td class="fast"><b>✓ 1 s</b>') == 1
    assert page.count('<td class="') == 2


def test_the_maps_are_there_as_markdown(reported):
    lines = (reported[1] / "maps.md").read_text(encoding="utf-8").splitlines()
    assert lines[:4] == ["### maglev", "", "|  | radar | loop |", "| --- | --- | --- |"]
    assert lines[4].startswith("| bias +5 m/s | ")
    assert lines[5] == "| silent for 2 s |  | ✓ 1 s |"


def test_a_fault_that_had_nothing_to_act_on_is_not_called_unfound(tmp_path):
    """WHEN a reader lies only about a balise that the train never comes to, THEN that is said in its own word, and no share."""
    faults = [
        {"label": "far away", "kind": "wrong_balise", "options": {"balise": "b02000"}, "units": ["balise-reader"]},
        {"label": "any", "kind": "missed_balise", "units": ["balise-reader"]},
    ]
    report = tmp_path / "report"
    done = campaign(written(tmp_path, trains={"maglev": {"train": "maglev", "duration_s": 8.0}}, faults=faults), "--json",
                    "--report", report)  # fmt: skip
    far, any_ = json.loads(done.stdout)["cells"]
    assert (far["detected_percent"], far["never_acted_runs"]) == (None, 2)
    assert (any_["detected_percent"], any_["never_acted_runs"]) == (0.0, 0), "a balise passed, and its telegram was kept back"
    page = (report / "index.html").read_text(encoding="utf-8")
    assert page.count("<b>– never acted</b>") == 1
    assert page.count("<b>? not found</b>") == 1


def test_a_report_of_another_campaign_is_not_replaced(tiny, reported, tmp_path):
    _, report = reported
    before = (report / "index.html").read_bytes()
    done = campaign(written(tmp_path, campaign="another"), "--report", report)
    assert done.returncode == 2
    place = report / "results.json"
    assert done.stderr == f"milepost: {place}: is the report of the campaign 'tiny'; choose another folder for 'another'\n"
    assert (report / "index.html").read_bytes() == before


def test_finished_runs_are_taken_from_the_file(tiny, reported, tmp_path):
    """A figure that is changed in the file shows that the run was not made again; a run that is not there is made."""
    lines = (reported[1] / "runs.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 4
    entry = json.loads(lines[0])
    entry["figures"]["resets"] = 77
    kept = tmp_path / "runs.jsonl"
    kept.write_text("\n".join([json.dumps(entry), *lines[1:3]]) + "\n", encoding="utf-8")
    again = json.loads(campaign(tiny, "--json", "--resume", kept).stdout)
    assert sum(cell["resets"] for cell in again["cells"]) >= 77
    assert len(kept.read_text(encoding="utf-8").splitlines()) == 4


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_campaign_that_is_ended_goes_on_where_it_was(tmp_path, how):
    path, kept = written(tmp_path, runs=30, trains=BRIEF), tmp_path / "runs.jsonl"
    running = subprocess.Popen(
        command(path, "--jobs", 2, "--resume", kept),
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        while not kept.exists() or kept.read_bytes().count(b"\n") < 2:
            with pytest.raises(subprocess.TimeoutExpired):
                running.wait(timeout=0.05)
        end(running, how)
    finally:
        running.kill()
    finished = kept.read_bytes().count(b"\n")
    assert 2 <= finished < 60
    resumed = campaign(written(tmp_path, runs=2, trains=BRIEF), "--json", "--jobs", 1, "--resume", kept)
    whole = campaign(path, "--json", "--jobs", 1, "--runs", 2)
    assert resumed.stdout == whole.stdout
    assert kept.read_bytes().count(b"\n") >= finished


def test_a_worker_that_is_killed_is_one_line(tmp_path):
    path, kept = written(tmp_path, runs=100), tmp_path / "runs.jsonl"
    line = command(path, "--jobs", 2, "--resume", kept)
    running = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        while not kept.exists() or kept.read_bytes().count(b"\n") < 2:
            with pytest.raises(subprocess.TimeoutExpired):
                running.wait(timeout=0.05)
        # a worker has had more of the processor than those that only serve
        max(psutil.Process(running.pid).children(), key=lambda child: child.cpu_times().user).kill()
        _, said = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == 2
    assert said == f"milepost: {path}: a process that made runs was killed; finished runs are in {kept}\n"


@pytest.mark.parametrize(
    ("fields", "options", "said"),
    [
        ({"faults": [{"label": "a", "kind": "bais"}]}, [], "tiny.yaml: faults.0.kind: must be one of bias"),
        (
            {"trains": {"a": {"train": "maglev", "duration_s": 0.01}}, "faults": []},
            ["--report", "README.md"],
            "is not a folder",
        ),
        ({}, ["--resume", "tests"], "tests: Is a directory"),
        ({}, ["--dask", "tcp://127.0.0.1:1", "--jobs", "2"], "--jobs: is for this machine"),
    ],
    ids=["file", "report", "resume", "jobs"],
)
def test_a_mistake_is_one_line_and_exit_code_2(tmp_path, fields, options, said):
    done = campaign(written(tmp_path, **fields), *options)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert said in done.stderr


def test_without_json_it_is_a_table_and_a_verdict(tiny, reported, results):
    out = campaign(tiny, "--resume", reported[1] / "runs.jsonl").stdout.splitlines()
    assert sum(line.startswith("maglev ") for line in out) == 2
    failed = sum(cell["violation_runs"] for cell in results["cells"])
    assert out[-1].startswith(f"The truth left an interval in {failed} of 4 runs")
