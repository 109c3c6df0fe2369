"""`milepost campaign`: every fault on every unit on many seeds, on this machine or on a Dask cluster."""

from __future__ import annotations

import json
import os
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from milepost.campaign.campaign import Executor, locally, run_campaign, work_s
from milepost.campaign.campaign_file import load_campaign
from milepost.campaign.cells import cells
from milepost.campaign.report import write_report
from milepost.campaign.results_file import results_file
from milepost.campaign.text import table
from milepost.config.yaml_files import ConfigError

from .showing.progress import progress_bar

RESULTS = "runs.jsonl"


def run_campaign_command(
    path: Path,
    runs: int | None,
    jobs: int | None,
    seed: int | None,
    as_json: bool,
    report: Path | None,
    resume: Path | None,
    dask: str | None,
) -> int:
    """Run a campaign and print its figures; 1 where the truth left an interval or a node crashed. Raises ConfigError."""
    if report is not None and report.exists() and not report.is_dir():
        raise ConfigError(report, "", "is not a folder")
    file = load_campaign(path)
    _check_report(report, file.campaign)
    planned = cells(path, file, runs, seed)
    kept = resume if resume is not None or report is None else report / RESULTS
    text = f"{file.campaign}, {len(planned)} cells" if len(planned) > 1 else file.campaign
    with results_file(kept) as results, progress_bar(text, work_s(planned)) as show:
        try:
            campaign = run_campaign(file, planned, _executor(dask, jobs), results, show)
        except BrokenProcessPool as error:
            kept_text = "" if kept is None else f"; finished runs are in {kept}"
            raise ConfigError(path, "", f"a process that made runs was killed{kept_text}") from error
    if report is not None:
        write_report(report, campaign)
    print(json.dumps(campaign.as_dict()) if as_json else table(campaign))
    return int(bool(campaign.violated))


def _check_report(folder: Path | None, campaign: str) -> None:
    """Whether a folder holds no report, or one of this campaign. Raises ConfigError."""
    results = None if folder is None else folder / "results.json"
    if results is None or not results.is_file():
        return
    try:
        there = json.loads(results.read_text(encoding="utf-8"))["campaign"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ConfigError(results, "", "is no report of a campaign; choose another folder") from error
    if there != campaign:
        raise ConfigError(results, "", f"is the report of the campaign {there!r}; choose another folder for {campaign!r}")


def _executor(dask: str | None, jobs: int | None) -> Executor:
    if dask is None:
        return locally(jobs or os.cpu_count() or 1)
    if jobs is not None:
        raise ConfigError("campaign", "--jobs", "is for this machine; with --dask the cluster's workers make the runs")
    from milepost.campaign.dask_cluster import on_dask

    return on_dask(dask)
