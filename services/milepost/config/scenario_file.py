"""The model of scenario files; deploy/scenarios/README.md is their guide."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, Field, ValidationInfo, model_validator

from milepost.recordings.options import STRICT, DataPath, Span
from milepost.simulation.faults import FaultEntry
from milepost_schemas.message import Name
from milepost_schemas.reading import Solution

from .shipped_files import named_in_file
from .train import Train, load_train
from .train_file import Positive
from .yaml_files import ConfigError, merged, read_yaml, validate


def _train_file(value: object, info: ValidationInfo) -> object:
    """A train by name or by a path relative to the scenario file."""
    if not isinstance(value, str):
        return value
    try:
        return named_in_file(value, (info.context or {}).get("folder", Path()), "trains").resolve()
    except ConfigError as error:
        raise ValueError(str(error)) from error


Builtin = Literal["fused", "federated", "centralised"]
Window = list[Span] | Literal["creep"]


class WithheldFile(BaseModel):
    """Fixes of a unit's recording that are withheld from the filters and compared with the result.

    Only fixes of one `solution` are compared.
    """

    model_config = STRICT
    unit: Name
    from_s: float
    to_s: float
    solution: Solution = "rtk_fixed"


class EstimatorFile(BaseModel):
    """An estimator: the scenario's train with `change` and its own rule, run in nodes of its own.

    `faults`: in place of those of the scenario or variant.
    """

    model_config = STRICT
    change: dict[str, Any] = Field(default_factory=dict)
    rule: Name | None = None
    faults: list[FaultEntry] | None = None


class VariantFile(BaseModel):
    """The whole comparison under other conditions. A field that is not given is the scenario's."""

    model_config = STRICT
    change: dict[str, Any] = Field(default_factory=dict)
    faults: list[FaultEntry] | None = None
    compare: list[Builtin] | None = None
    estimators: list[Name] | None = None
    alone: list[Name] | None = None
    windows: dict[Name, Window] = Field(default_factory=dict)


class ClaimFile(BaseModel):
    """A claim of a source, and the target of Milepost: the figure `key` of the estimator `ours`.

    `key`: a figure's name, with `.` into a map (`gap_error_m.30`). `over`: divide by this estimator's figure, seed by
    seed. `of`: the statistic over all seeds that the target is compared with; `pooled`: the root mean square, divided by
    that of `over`. `why`: the reason shown if the target is not met. Without a target the figure is shown and not judged.
    """

    model_config = STRICT
    key: str
    source: str
    says: str
    label: str = ""
    at_most: float | None = None
    at_least: float | None = None
    of: Literal["median", "worst", "pooled"] = "median"
    over: Name | None = None
    variant: Name | None = None
    ours: Name = "fused"
    method: Name | None = "federated"
    optimum: Name | None = "centralised"
    why: str = ""

    @model_validator(mode="after")
    def _one_target(self) -> ClaimFile:
        if self.at_most is not None and self.at_least is not None:
            raise ValueError("either at_most or at_least is required, not both")
        return self


class ScenarioFile(BaseModel):
    """An evaluation: a train by name or file, changes to its file, a duration, the estimators to compare, scores and claims.

    `needs`: files without which the scenario is skipped. `seeds`: the largest number of seeds that differ. `faults`: of the
    units' sensors, the same for all estimators. `scores`: the key in the results → {`score`: a row of the table of scores,
    where the key is not its name; `within`: a window; its options}.
    """

    model_config = STRICT
    scenario: Name
    about: str = ""
    train: Annotated[Path, BeforeValidator(_train_file)]
    duration_s: Positive
    seed: Annotated[int, Field(ge=0)] = 1
    seeds: Annotated[int, Field(ge=1)] | None = None
    needs: list[DataPath] = Field(default_factory=list)
    change: dict[str, Any] = Field(default_factory=dict)
    faults: list[FaultEntry] = Field(default_factory=list)
    compare: list[Builtin] = ["fused", "federated", "centralised"]
    estimators: dict[Name, EstimatorFile] = Field(default_factory=dict)
    alone: list[Name] = Field(default_factory=list)
    variants: dict[Name, VariantFile] = Field(default_factory=dict)
    windows: dict[Name, Window] = Field(default_factory=dict)
    scores: dict[Name, dict[str, Any] | None] = Field(default_factory=dict)
    claims: list[ClaimFile] = Field(default_factory=list)
    speed_after_s: Annotated[float, Field(ge=0.0)] = 0.0
    withheld: WithheldFile | None = None


def load_scenario(path: Path, seed: int | None = None, rule: str | None = None) -> tuple[ScenarioFile, Train]:
    """A scenario and its train, with changes, seed and rule laid over the train file. Raises ConfigError."""
    scenario = validate(path, read_yaml(path), ScenarioFile)
    change = merged(scenario.change, {"fusion": {"rule": rule}}) if rule is not None else scenario.change
    try:
        return scenario, load_train(scenario.train, change, scenario.seed if seed is None else seed)
    except ConfigError as error:
        # without an error here the train is valid by itself, and the mistake is in the change
        load_train(scenario.train)
        raise ConfigError(path, "change", str(error)) from error
