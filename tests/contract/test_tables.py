"""The tables agree with each other."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from examples import EXAMPLES, SENSOR_OPTIONS, options_of
from milepost.config.roles import ROLES, process_name, processes
from milepost.config.train import load_train
from milepost.estimation.filters import FILTERS
from milepost.estimation.fusion import RULES
from milepost.estimation.layout import COMMON
from milepost.evaluation.scores import SCORES
from milepost.sensors import SENSORS
from milepost.sensors.base import Sensor
from milepost_schemas import BY_NAME, COMMON_STATES, STREAMS

ROOT = Path(__file__).resolve().parents[2]
SERVICES = ROOT / "services" / "milepost"


def test_the_stream_table_can_be_asked_by_name() -> None:
    assert list(BY_NAME.values()) == list(STREAMS)
    assert set(EXAMPLES) == set(BY_NAME), "tests/examples.py: EXAMPLES and the stream table differ"


def test_the_sensor_table_has_every_kind_in_the_folder() -> None:
    found = {
        node.name
        for path in (SERVICES / "sensors").rglob("*.py")
        if path.name != "base.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and any("Sensor[" in ast.unparse(base) for base in node.bases)
        # what several kinds have in common is no kind
        and any(ast.unparse(line).startswith("kind = ") for line in node.body)
    }
    assert {kind.__name__ for kind in SENSORS.values()} == found
    assert set(SENSORS) == set(SENSOR_OPTIONS), "tests/examples.py: SENSOR_OPTIONS and the sensor table differ"


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_a_sensors_row_is_consistent_with_the_other_tables(kind: str) -> None:
    row = SENSORS[kind]
    assert issubclass(row, Sensor)
    assert row.kind == kind
    assert row.stream in BY_NAME
    assert BY_NAME[row.stream].key.startswith("reading/")
    options = row.options_model.model_validate(options_of(kind))
    assert options.filter is None or options.filter in FILTERS
    assert len(list((SERVICES / "sensors").rglob(f"{kind}.py"))) == 1, "one file for each kind, called like it"


@pytest.mark.parametrize("name", sorted(FILTERS))
def test_a_filter_can_be_named_in_a_train_file(name: str) -> None:
    assert name.replace("_", "").isalnum()
    assert name.islower()
    assert callable(FILTERS[name].take)


def test_filters_and_rules_are_each_something_else() -> None:
    assert len(set(FILTERS.values())) == len(FILTERS)
    assert len(set(RULES.values())) == len(RULES)
    assert "kalman" in FILTERS
    assert {"information", "federated"} <= set(RULES)


@pytest.mark.parametrize("name", sorted(SCORES))
def test_a_score_can_be_asked_for_by_a_scenario_file_and_refuses_options_that_it_does_not_have(name: str) -> None:
    assert name.replace("_", "").isalnum()
    assert name.islower()
    assert SCORES[name].options.model_config["extra"] == "forbid"


def test_the_role_table_is_filed_by_name_and_listeners_come_before_speakers() -> None:
    assert all(role.name == name for name, role in ROLES.items())
    order = list(ROLES)
    assert order.index("fuser") < order.index("filter") < order.index("sensor") < order.index("world")
    assert order.index("balise") < order.index("sensor")
    assert all(role.purpose for role in ROLES.values())


def test_process_names_are_unique_and_can_stand_in_a_key() -> None:
    train = load_train(ROOT / "deploy" / "trains" / "maglev.yaml")
    listed = processes(train)
    assert len({process.name for process in listed}) == len(listed)
    for process in listed:
        assert process.name == process_name(process.role, process.unit)
        assert BY_NAME["health"].key_for(train.name, process.name).count("/") == 4
    assert {process.role for process in listed} == set(ROLES)


def test_contract_and_estimator_mean_the_same_common_states() -> None:
    assert tuple(COMMON) == tuple(COMMON_STATES)
