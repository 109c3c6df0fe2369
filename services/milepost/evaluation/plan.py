"""A scenario file made ready: the trains of all conditions loaded, and everything checked before any work."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from milepost.config.faults import check_faults
from milepost.config.scenario_file import Builtin, ScenarioFile, VariantFile, Window, load_scenario
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError, merged, validate
from milepost.recordings.gnss_log import RecordedFix
from milepost.sensors.base import World
from milepost.sensors.odometer.odometer import Odometer
from milepost.simulation.faults import FaultEntry

from .recorded_scores import FixesOptions, UnitsOptions, check_recorded_unit
from .scores import BASIC, BASIC_WITHOUT_TRUTH, SCORES, Figure, Score, UnitOptions
from .summary import OF_THE_RUN
from .trace import Trace
from .withheld import withheld_fixes

CREEP_AT_LEAST = 1e-4
# figures of every estimator or of the run that compare states with the true ones
NEED_TRUTH = (*BASIC, "fused_over_centralised")


@dataclass(frozen=True)
class RequestedScore:
    """A figure that the scenario asks for: a row of the table of scores, its options, the window it is limited to.

    `estimator`: the one that it is computed for; None where it is computed for each.
    """

    key: str
    score: Score
    options: Any
    window: Window | None
    estimator: str | None = None

    def of(self, trace: Trace, train: Train, world: World | None) -> Figure | None:
        """The figure; None where the estimator has no such figure, or no epoch in the window."""
        if self.window is not None:
            inside = epochs_within(self.window, trace, train, world)
            if not inside.any():
                return None
            trace = trace.within(inside)
        return self.score.compute(trace, train, self.options)


@dataclass(frozen=True)
class Case:
    """One condition: the scenario's own (`name` is empty) or a variant's, and the trains that run under it.

    `comparators`: estimator → its train, for the estimators that run nodes of their own beside the scenario's train.
    `faults`: those of the scenario's train; `own_faults`: of the comparators that have others.
    """

    name: str
    train: Train
    comparators: Mapping[str, Train]
    faults: tuple[FaultEntry, ...]
    own_faults: Mapping[str, tuple[FaultEntry, ...]]
    compare: tuple[Builtin, ...]
    alone: tuple[str, ...]
    requested: tuple[RequestedScore, ...]
    fixes: tuple[RecordedFix, ...]

    @property
    def runs(self) -> int:
        """The number of trains that run."""
        return len(self.comparators) + 1


@dataclass(frozen=True)
class Plan:
    """A scenario on one seed."""

    path: Path
    scenario: ScenarioFile
    seed: int
    cases: tuple[Case, ...]

    @property
    def more_is_better(self) -> set[str]:
        """The keys of the figures whose worst value is the smallest."""
        return {requested.key for requested in self.cases[0].requested if requested.score.more_is_better}

    @property
    def work_s(self) -> float:
        """Seconds of scenario time that all trains run together."""
        return sum(case.runs for case in self.cases) * self.scenario.duration_s


def make_plan(path: Path, seed: int | None = None) -> Plan:
    """Load and check a scenario. Raises ConfigError."""
    scenario, _ = load_scenario(path, seed)
    seed = scenario.seed if seed is None else seed
    cases = [_case(path, scenario, seed, "", VariantFile())]
    cases += [_case(path, scenario, seed, name, variant) for name, variant in scenario.variants.items()]
    _check_claims(path, scenario, {case.name: case.train for case in cases})
    return Plan(path, scenario, seed, tuple(cases))


def _case(path: Path, scenario: ScenarioFile, seed: int, name: str, variant: VariantFile) -> Case:
    place = f"variants.{name}." if name else ""
    common = [scenario.change, variant.change]
    train = _train(path, scenario, seed, common, f"{place}change")
    if not train.has_scenario_time:
        raise ConfigError(path, f"{place}train", f"{train.path} has neither a `world` nor a recording")
    compare = scenario.compare if variant.compare is None else variant.compare
    comparators, own_faults = {}, {}
    faults = scenario.faults if variant.faults is None else variant.faults
    check_faults(train, faults, path, "faults" if variant.faults is None else f"{place}faults")
    if "federated" in compare:
        comparators["federated"] = _train(path, scenario, seed, [*common, {"fusion": {"rule": "federated"}}], f"{place}change")
    for taken in scenario.estimators.keys() & {*get_args(Builtin), *(f"{unit}_only" for unit in scenario.alone)}:
        raise ConfigError(path, f"estimators.{taken}", "the name of a built-in estimator")
    for chosen in scenario.estimators if variant.estimators is None else variant.estimators:
        if chosen not in scenario.estimators:
            raise ConfigError(path, f"{place}estimators", f"{chosen} is not among the scenario's estimators")
        file = scenario.estimators[chosen]
        rule = [{"fusion": {"rule": file.rule}}] if file.rule else []
        comparators[chosen] = _train(path, scenario, seed, [*common, file.change, *rule], f"estimators.{chosen}")
        if _has_truth(comparators[chosen]) != _has_truth(train):
            raise ConfigError(path, f"estimators.{chosen}.change.world", "either all estimators have a truth, or none")
        check_faults(comparators[chosen], file.faults or (), path, f"estimators.{chosen}.faults")
        if file.faults is not None:
            own_faults[chosen] = tuple(file.faults)
    alone = scenario.alone if variant.alone is None else variant.alone
    # what cannot be compared afterwards is an error before the work, not after it
    for unit in alone:
        if unit not in train.fused_units:
            raise ConfigError(path, f"{place}alone", f"{unit} has no filter in {train.path}")
    fixes = withheld_fixes(path, scenario, train) if scenario.withheld is not None else []
    windows = {**scenario.windows, **variant.windows}
    requested = tuple(_requested(path, key, options or {}, scenario, windows) for key, options in scenario.scores.items())
    for each in requested:
        _check_requested(path, train, each)
    return Case(name, train, comparators, tuple(faults), own_faults, tuple(compare), tuple(alone), requested, tuple(fixes))


def _check_requested(path: Path, train: Train, requested: RequestedScore) -> None:
    """Whether a train has what a score is made of. Raises ConfigError."""
    field, options = f"scores.{requested.key}", requested.options
    if requested.score.needs_truth and not _has_truth(train):
        raise ConfigError(path, field, f"needs a truth, and {train.path} has no `world`")
    if requested.window == "creep" and (train.file.world is None or train.file.world.creep is None):
        raise ConfigError(path, f"{field}.within", "the wheels of this world do not creep")
    if isinstance(options, UnitOptions) and not isinstance(train.sensors.get(options.unit), Odometer):
        raise ConfigError(path, f"{field}.unit", f"{options.unit} is no odometer of {train.path}")
    if isinstance(options, FixesOptions):
        check_recorded_unit(path, f"{field}.unit", train, options.unit, "position_reading")
    if isinstance(options, UnitsOptions):
        for unit in options.units:
            check_recorded_unit(path, f"{field}.units", train, unit, "speed_reading")


def _has_truth(train: Train) -> bool:
    return train.file.world is not None


def _train(path: Path, scenario: ScenarioFile, seed: int, changes: Iterable[Mapping[str, Any]], field: str) -> Train:
    change: dict[str, Any] = {}
    for each in changes:
        change = merged(change, each)
    try:
        return load_train(scenario.train, change, seed)
    except ConfigError as error:
        raise ConfigError(path, field, str(error)) from error


def _requested(
    path: Path, key: str, entry: Mapping[str, Any], scenario: ScenarioFile, windows: Mapping[str, Window]
) -> RequestedScore:
    name, within, estimator = str(entry.get("score", key)), entry.get("within"), entry.get("estimator")
    if name not in SCORES:
        raise ConfigError(path, f"scores.{key}", f"must be one of {', '.join(SCORES)}, not {name!r}")
    if within is not None and str(within) not in windows:
        raise ConfigError(path, f"scores.{key}.within", f"must be one of the windows {', '.join(windows)}, not {within!r}")
    if estimator is not None and str(estimator) not in scenario.estimators:
        raise ConfigError(path, f"scores.{key}.estimator", f"must be one of the scenario's estimators, not {estimator!r}")
    options = {option: value for option, value in entry.items() if option not in ("score", "within", "estimator")}
    row = SCORES[name]
    window = None if within is None else windows[str(within)]
    return RequestedScore(key, row, validate(path, options, row.options, f"scores.{key}"), window, estimator)


def _check_claims(path: Path, scenario: ScenarioFile, trains: Mapping[str, Train]) -> None:
    """Whether what is claimed will be computed; `trains` by the name of their case. Raises ConfigError."""
    names = {*scenario.compare, *scenario.estimators, *(f"{unit}_only" for unit in scenario.alone)}
    for number, claim in enumerate(scenario.claims):
        if claim.variant is not None and claim.variant not in scenario.variants:
            raise ConfigError(path, f"claims.{number}.variant", f"{claim.variant} is not among the variants")
        train = trains[claim.variant or ""]
        if claim.key in NEED_TRUTH and not _has_truth(train):
            raise ConfigError(path, f"claims.{number}.key", f"{claim.key} needs a truth, and {train.path} has no `world`")
        keys = {*(BASIC if _has_truth(train) else BASIC_WITHOUT_TRUTH), *scenario.scores, *OF_THE_RUN}
        if claim.key.partition(".")[0] not in keys:
            raise ConfigError(path, f"claims.{number}.key", f"{claim.key} is neither a basic figure nor among the scores")
        for field in ("ours", "method", "optimum", "over"):
            name = getattr(claim, field)
            # federated and centralised are defaults: a scenario without them has no such column
            if name is not None and name not in names and field in claim.model_fields_set:
                raise ConfigError(path, f"claims.{number}.{field}", f"{name} is not among the estimators compared")


def epochs_within(window: Window, trace: Trace, train: Train, world: World | None) -> Any:
    """Which epochs of a trace lie in a window: in one of its spans, or wherever the wheel of a unit creeps."""
    if window != "creep":
        return np.any([(trace.t_s >= a) & (trace.t_s < b) for a, b in window], axis=0)
    creep = world.creep if world is not None else None
    if creep is None:
        return np.zeros(len(trace.t_s), dtype=bool)
    return np.array([any(abs(creep.at(unit, t)) >= CREEP_AT_LEAST for unit in train.sensors) for t in trace.t_s.tolist()])
