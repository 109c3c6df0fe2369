"""Pictures of an evaluation: errors with the published interval, estimator beside estimator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from milepost.runtime.scenario_file import ScenarioFile

from .trace import Trace


def draw(path: Path, scenario: ScenarioFile, traces: Mapping[str, Trace]) -> None:
    """Two panels over time: position error with the published interval, speed error."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(10, 7), sharex=True, layout="constrained")
    for name, trace in traces.items():
        style = {"linestyle": "--", "color": "black"} if name == "centralised" else {}
        above.plot(trace.t_s, trace.errors[:, 0], label=name, linewidth=1.0, **style)
        below.plot(trace.t_s, trace.errors[:, 1], label=name, linewidth=1.0, **style)
    ours = traces.get("fused")
    if ours is not None and ours.bounds is not None:
        position, speed = (ours.truth + ours.errors)[:, :2].T
        above.fill_between(ours.t_s, *(ours.bounds[:, :2].T - position), alpha=0.12, label="published interval")
        below.fill_between(ours.t_s, *(ours.bounds[:, 2:].T - speed), alpha=0.12)
    above.set_ylabel("position error [m]")
    below.set_ylabel("speed error [m/s]")
    below.set_xlabel("time [s]")
    above.legend(ncols=3, fontsize="small")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.suptitle(scenario.scenario)
    figure.savefig(path, dpi=120)
    plt.close(figure)
