"""A scenario on the memory bus, estimator beside estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from milepost.checks.figures import check_all
from milepost.config.fusion_settings import full_layout, prior
from milepost.config.yaml_files import ConfigError
from milepost.estimation.centralised import centralised
from milepost.estimation.time_units import S_PER_NS
from milepost.offline.collector import rare_collection
from milepost.offline.memory_bus import Tap
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.sensors.base import World

from .plan import Case, Plan
from .run_log import RunLog
from .scores import basic
from .trace import Trace, largest_difference_in_sigmas, trace_of_beliefs, trace_of_states
from .withheld import score_withheld

ProgressCallback = Callable[[float], None]
Traces = dict[str, Trace]
NOT_SCORED = "no truth: position and speed errors are not scored"


@dataclass(frozen=True)
class Run:
    """A scenario on one seed: its figures, the log of its own train, the traces of every case and estimator."""

    result: dict[str, Any]
    log: RunLog
    traces: dict[str, Traces]


def run_plan(plan: Plan, also: Tap | None, progress: ProgressCallback) -> Run:
    """All cases of a plan, one after another; `progress` is told the seconds of scenario time done. Raises ConfigError."""
    scenario = plan.scenario
    result: dict[str, Any] = {"scenario": scenario.scenario, "seed": plan.seed, "duration_s": scenario.duration_s}
    figures, own, traces = _run_case(plan, plan.cases[0], also, progress)
    result |= figures
    kept, done = {"": traces}, plan.cases[0].runs * scenario.duration_s
    for case in plan.cases[1:]:
        figures, _, kept[case.name] = _run_case(plan, case, None, later(progress, done))
        result.setdefault("variants", {})[case.name] = figures
        done += case.runs * scenario.duration_s
    return Run(result, own, kept)


def _run_case(plan: Plan, case: Case, also: Tap | None, progress: ProgressCallback) -> tuple[dict[str, Any], RunLog, Traces]:
    duration_s = plan.scenario.duration_s
    log = RunLog(case.train, also)
    ended_s = simulate(case.train, duration_s, log.tap, log.keep, progress, case.faults)
    if log.truth and log.truth.keys().isdisjoint(log.live):
        raise ConfigError(plan.path, "duration_s", "the run ends before there is a state to be compared with the truth")
    if not log.live:
        raise ConfigError(plan.path, "duration_s", "the run ends before there is a state")
    traces: Traces = {}
    if "fused" in case.compare:
        traces["fused"] = _of_run(log, settled=True)
    for done, (name, train) in enumerate(case.comparators.items(), start=1):
        comparator = RunLog(train)
        suffers = case.own_faults.get(name, case.faults)
        simulate(train, duration_s, comparator.tap, None, later(progress, done * duration_s), suffers)
        traces[name] = _of_run(comparator, settled=False)
    if "centralised" in case.compare:
        traces["centralised"] = _centralised(log, None)
    for unit in case.alone:
        traces[f"{unit}_only"] = _centralised(log, unit)
    figures = _figures(plan, case, log, traces)
    # said only where it is less than what was asked for
    return figures if ended_s >= duration_s else {"ended_s": ended_s, **figures}, log, traces


def later(progress: ProgressCallback, done_s: float) -> ProgressCallback:
    """Progress of work that begins when `done_s` seconds of scenario time are done."""
    return lambda t_s: progress(done_s + t_s)


def _figures(plan: Plan, case: Case, log: RunLog, traces: Traces) -> dict[str, Any]:
    needs_world = any(requested.window == "creep" for requested in case.requested)
    world = case.train.world(plan.scenario.duration_s) if needs_world else None
    estimators: dict[str, Any] = {}
    for name, trace in traces.items():
        estimators[name] = basic(trace, plan.scenario.speed_after_s)
        estimators[name] |= _requested(case, name, traces, world)
    result: dict[str, Any] = {"estimators": estimators}
    if not log.truth:
        result["not_scored"] = NOT_SCORED
    checks = {name: check_all(trace) for name, trace in traces.items()}
    if any(checks.values()):
        result["checks"] = {name: found for name, found in checks.items() if found}
    if {"fused", "centralised"} <= set(traces):
        ours, best = estimators["fused"], estimators["centralised"]
        if log.truth:
            result["fused_over_centralised"] = ours["position_rms_m"] / best["position_rms_m"]
        result["fused_minus_centralised_max_sigma"] = largest_difference_in_sigmas(traces["fused"], traces["centralised"])
    if case.fixes:
        period_ns = case.train.file.fusion.period_ms * 1_000_000
        try:
            result |= score_withheld(log.settled, case.fixes, case.train.line, OFFLINE_START_NS, period_ns)
        except ValueError as error:
            raise ConfigError(plan.path, "withheld", str(error)) from error
    return result


def _requested(case: Case, name: str, traces: Traces, world: World | None) -> dict[str, Any]:
    """The requested figures of an estimator; those of `fused` include the ones that are computed for one estimator alone."""
    out = {}
    for requested in case.requested:
        of = name if requested.estimator is None else requested.estimator if name == "fused" else None
        figure = requested.of(traces[of], case.comparators.get(of, case.train), world) if of in traces else None
        if figure is not None:
            out[requested.key] = figure
    return out


def _of_run(log: RunLog, settled: bool) -> Trace:
    states, names = log.settled if settled else log.live, full_layout(log.train).names
    known_to_m = {balise.balise_id: balise.location_accuracy_m for balise in log.train.line.balises}
    trace = trace_of_states(states, log.truth, OFFLINE_START_NS, log.live, log.private, names, known_to_m)
    counted = {unit: (np.array(sorted(times)) - OFFLINE_START_NS) * S_PER_NS for unit, times in log.counted.items()}
    return replace(trace, counted=counted)


def _centralised(log: RunLog, unit: str | None) -> Trace:
    train = log.train
    everything = full_layout(train)
    layout = everything if unit is None else everything.only([unit])
    start = prior(train)
    begins_ns = log.begins_ns(*everything.prior(start.mean, start.std), everything)
    epochs_ns = list(log.truth or log.settled)
    with rare_collection():
        results = centralised(
            log.centralised_readings(unit), epochs_ns, layout, train.file.motion_model.jerk_psd_m2ps5, start, begins_ns
        )
        beliefs = {at: (mean, covariance) for at, mean, covariance in results}
        return trace_of_beliefs(beliefs, log.truth, OFFLINE_START_NS, layout.names)
