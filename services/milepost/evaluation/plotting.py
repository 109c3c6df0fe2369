"""Pictures of an evaluation: errors with the published interval, shares over time, wheel diameter over distance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from milepost.config.train import Train

from .scores import estimated_diameter_m, true_diameter_m
from .trace import Trace

Spans = Sequence[tuple[str, float, float]]
SIZE = (10.0, 6.4)
WITNESS = {"linestyle": "--", "color": "black", "linewidth": 0.9, "zorder": 5}
OTHERS = ("#e07b00", "#8a4fbf", "#2a9d5c", "#c0392b", "#7a6a58", "#d45fa0")
OURS = {"color": "#0b6fb8", "linewidth": 1.3, "zorder": 4}


def draw_errors(path: Path, title: str, traces: Mapping[str, Trace], ours: str = "fused", shaded: Spans = ()) -> None:
    """Two panels over time: position error and speed error, with the interval that `ours` published."""
    figure, (above, below) = plt.subplots(2, 1, figsize=SIZE, sharex=True, layout="constrained")
    colours = cycle(OTHERS)
    for name, trace in traces.items():
        style = _style(name, ours, colours)
        above.plot(trace.t_s, trace.errors[:, 0], label=name, **style)
        below.plot(trace.t_s, trace.errors[:, 1], label=name, **style)
    mine = traces.get(ours)
    if mine is not None and mine.bounds is not None:
        position, speed = mine.states[:, :2].T
        for axes, bounds, centre in ((above, mine.bounds[:, :2], position), (below, mine.bounds[:, 2:], speed)):
            axes.fill_between(mine.t_s, *(bounds.T - centre), color=OURS["color"], alpha=0.12, label=f"interval of {ours}")
    _limit(above, [trace.errors[:, 0] for trace in traces.values()])
    _limit(below, [trace.errors[:, 1] for trace in traces.values()])
    above.set_ylabel("position error [m]")
    below.set_ylabel("speed error [m/s]")
    below.set_xlabel("time [s]")
    above.legend(ncols=3, fontsize="small", loc="upper left")
    for name, a, b in shaded:
        for axes in (above, below):
            axes.axvspan(a, b, color="#888888", alpha=0.15, linewidth=0)
        below.annotate(name, (a, 0.02), xycoords=below.get_xaxis_transform(), fontsize="small", color="#555555")
    _finish(figure, (above, below), path, title)


def _style(name: str, ours: str, colours: Iterator[str]) -> dict[str, Any]:
    if name == ours:
        return OURS
    return WITNESS if name == "centralised" else {"linewidth": 0.9, "alpha": 0.9, "color": next(colours)}


def _limit(axes: Any, errors: Sequence[Any]) -> None:
    """Limit the axis to the errors and a margin: a much wider interval would flatten the curves."""
    sizes = [np.abs(error) for error in errors]
    reach = max(1.15 * max(float(size.max()) for size in sizes), 2.5 * max(float(np.quantile(size, 0.99)) for size in sizes))
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -reach), min(high, reach))


def draw_shares(path: Path, title: str, traces: Mapping[str, Trace]) -> None:
    """The shares of the units over time, a panel for each estimator."""
    figure, panels = plt.subplots(len(traces), 1, figsize=(10.0, 1.2 + 1.8 * len(traces)), squeeze=False, layout="constrained")
    for axes, (name, trace) in zip(panels[:, 0], traces.items(), strict=True):
        axes.stackplot(trace.t_s, *trace.shares.values(), labels=list(trace.shares), alpha=0.8)
        axes.set_ylabel(f"shares, {name}")
        axes.set_ylim(0.0, 1.0)
    panels[0, 0].legend(ncols=4, fontsize="small", loc="upper right")
    panels[-1, 0].set_xlabel("time [s]")
    _finish(figure, panels[:, 0], path, title)


def draw_diameter(path: Path, title: str, traces: Mapping[str, Trace], train: Train, units: Sequence[str]) -> None:
    """The estimated wheel diameter over the distance travelled, with its 2 σ, and the true one: a panel for each wheel."""
    figure, panels = plt.subplots(len(units), 1, figsize=(10.0, 1.2 + 2.6 * len(units)), squeeze=False, layout="constrained")
    for axes, unit in zip(panels[:, 0], units, strict=True):
        for name, trace in traces.items():
            scale, std = trace.private.get(f"{unit}.scale"), trace.private_std.get(f"{unit}.scale")
            if scale is None or std is None:
                continue
            travelled, diameter = trace.travelled_m, 1e3 * estimated_diameter_m(train, unit, scale)
            style = WITNESS if name == "centralised" else {"linewidth": 1.2}
            lines = axes.plot(travelled, diameter, label=name, **style)
            axes.fill_between(
                trace.travelled_m,
                *(diameter + k * 2.0 * std * diameter for k in (-1, 1)),
                color=lines[0].get_color(),
                alpha=0.12,
            )
        first = next(iter(traces.values()))
        true = true_diameter_m(train, unit, first.t_s)
        if true is not None:
            axes.plot(first.travelled_m, 1e3 * true, label="true", color="#c0392b", linewidth=1.0)
            axes.set_ylim(1e3 * true.min() * 0.985, 1e3 * true.max() * 1.015)
        axes.set_ylabel(f"{unit} diameter [mm]")
    panels[0, 0].legend(ncols=4, fontsize="small")
    panels[-1, 0].set_xlabel("distance travelled [m]")
    _finish(figure, panels[:, 0], path, title)


def _finish(figure: Any, panels: Any, path: Path, title: str) -> None:
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.margins(x=0.0)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)
