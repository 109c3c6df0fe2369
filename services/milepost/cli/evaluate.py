"""`milepost evaluate`: a scenario on the memory bus, estimator beside estimator."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

from milepost.evaluation.scenario_run import evaluate_once
from milepost.evaluation.summary import summary
from milepost.runtime.config import load_scenario
from milepost.runtime.memory_bus import Tap
from milepost.runtime.recording import write_line
from milepost.runtime.yaml_files import ConfigError

from .progress import progress_bar


def run_evaluate(path: Path, seed: int | None, runs: int, as_json: bool, plot: Path | None, record: Path | None) -> int:
    """Evaluate a scenario and print the figures. Raises ConfigError."""
    for file in (plot, record):
        if file is not None and not file.parent.is_dir():
            raise ConfigError(file, "", "its folder does not exist")
        if file is not None and file.is_dir():
            raise ConfigError(file, "", "is a folder")
    if plot is not None:
        # known to be missing before the work, not after it
        _import_plotting()
    scenario, _ = load_scenario(path)
    first = scenario.seed if seed is None else seed
    results = []
    with ExitStack() as stack:
        kept = stack.enter_context(record.open("w", encoding="utf-8")) if record is not None else None
        show = stack.enter_context(progress_bar(scenario.scenario, runs * 2 * scenario.duration_s))
        for run in range(runs):
            done = run * 2 * scenario.duration_s
            also = _writer(kept) if kept is not None and run == 0 else None
            result, _, traces = evaluate_once(path, first + run, also, lambda t: show(done + t))  # noqa: B023
            results.append(result)
            if plot is not None and run == 0:
                _import_plotting()(plot, scenario, traces)
    result = results[0] if runs == 1 else summary(results)
    print(json.dumps(result) if as_json else _table(result))
    return 0


def _writer(file: TextIO) -> Tap:
    return lambda output, now_ns: write_line(file, output.message.train, output, now_ns)


def _import_plotting() -> Any:
    try:
        from milepost.evaluation.plotting import draw
    except ImportError as error:
        raise ConfigError("evaluate", "--plot", "needs matplotlib: pip install 'milepost[plot]'") from error
    return draw


def _table(result: dict[str, Any]) -> str:
    keys = ("position_rms_m", "position_max_m", "position_final_m", "speed_rms_mps", "speed_max_mps", "nees_mean")
    lines = [f"{result['scenario']}: seed {result['seed']}, {result['duration_s']:g} s, {result.get('runs', 1)} run(s)"]
    lines.append(f"{'':14}" + "".join(f"{key:>18}" for key in keys))
    for name, figures in result["estimators"].items():
        lines.append(f"{name:14}" + "".join(f"{figures[key]:18.5f}" for key in keys))
    lines += [
        f"{key}: {value:.9g}"
        for key, value in result.items()
        if isinstance(value, (int, float)) and key not in ("seed", "duration_s", "runs")
    ]
    return "\n".join(lines)
