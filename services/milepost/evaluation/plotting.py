"""Pictures of an evaluation: errors with the published interval, estimator beside estimator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from milepost.runtime.offline import OFFLINE_START_NS
from milepost.runtime.scenario_file import ScenarioFile


def draw(path: Path, scenario: ScenarioFile, heard: Any, estimators: dict[str, Any]) -> None:
    """Two panels over time: position error with the published interval, speed error."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(10, 7), sharex=True, layout="constrained")
    for name, estimates in estimators.items():
        epochs = sorted(set(estimates) & set(heard.truth))
        t = np.array([(k - OFFLINE_START_NS) * 1e-9 for k in epochs])
        errors = np.array([np.asarray(estimates[k][0])[:2] - np.asarray(heard.truth[k])[:2] for k in epochs])
        style = {"linestyle": "--", "color": "black"} if name == "centralised" else {}
        above.plot(t, errors[:, 0], label=name, linewidth=1.0, **style)
        below.plot(t, errors[:, 1], label=name, linewidth=1.0, **style)
    epochs = sorted(set(heard.settled) & set(heard.truth))
    t = np.array([(k - OFFLINE_START_NS) * 1e-9 for k in epochs])
    reach = np.array([heard.settled[k].position_max_m - heard.settled[k].position_m for k in epochs])
    above.fill_between(t, -reach, reach, alpha=0.12, label="published interval")
    above.set_ylabel("position error [m]")
    below.set_ylabel("speed error [m/s]")
    below.set_xlabel("time [s]")
    above.legend(ncols=3, fontsize="small")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.suptitle(scenario.scenario)
    figure.savefig(path, dpi=120)
    plt.close(figure)
