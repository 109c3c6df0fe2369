"""The tables agree with each other."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from pydantic import ValidationError

from examples import EXAMPLES, REMOVED, write_train
from milepost.config.fusion_settings import fuser_settings
from milepost.config.roles import ROLES, process_name, processes
from milepost.config.train import load_train
from milepost.estimation.filters import FILTERS
from milepost.estimation.layout import COMMON
from milepost.evaluation.scores import SCORES
from milepost.fusion.rules import RULES
from milepost.sensors import SENSORS
from milepost_schemas import BY_NAME, COMMON_STATES, STREAMS

ROOT = Path(__file__).resolve().parents[2]
SERVICES = ROOT / "services" / "milepost"
# some kinds need a line with geometry
GEOMETRY = {"geojson": str(ROOT / "deploy/lines/airport-maglev.geojson"), "length_m": REMOVED}


def test_the_stream_table_is_indexed_by_name() -> None:
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


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_a_kind_of_sensor_agrees_with_the_other_tables(kind: str) -> None:
    row = SENSORS[kind]
    assert BY_NAME[row.stream].key == "reading/{unit}"
    assert len(list((SERVICES / "sensors").rglob(f"{kind}.py"))) == 1, "one file for each kind, named after it"


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_a_unit_needs_no_option_beside_its_kind(kind: str, tmp_path: Path) -> None:
    train = load_train(write_train(tmp_path, {"units.new": {"kind": kind}}, GEOMETRY))
    assert isinstance(train.sensors["new"], SENSORS[kind])
    assert ("new" in train.filters) == (train.sensors["new"].options.filter is not None)


@pytest.mark.parametrize("name", sorted(FILTERS))
def test_a_train_file_can_choose_each_filter(name: str, tmp_path: Path) -> None:
    assert load_train(write_train(tmp_path, {"units.radar.filter": name})).filters["radar"][0] is FILTERS[name]


@pytest.mark.parametrize("name", sorted(RULES))
def test_a_train_file_can_choose_each_rule(name: str, tmp_path: Path) -> None:
    assert fuser_settings(load_train(write_train(tmp_path, {"fusion.rule": name}))).rule == name


@pytest.mark.parametrize("table", [FILTERS, RULES, SCORES], ids=["filters", "rules", "scores"])
def test_no_two_rows_of_a_table_are_the_same(table: dict[str, object]) -> None:
    assert len({id(row) for row in table.values()}) == len(table)


@pytest.mark.parametrize("name", sorted(SCORES))
def test_a_score_refuses_an_option_that_it_does_not_have(name: str) -> None:
    with pytest.raises(ValidationError, match="invented"):
        SCORES[name].options.model_validate({"invented": 1})


def test_listeners_start_before_speakers() -> None:
    order = list(ROLES)
    assert order.index("fuser") < order.index("filter") < order.index("sensor") < order.index("world")
    assert order.index("balise") < order.index("sensor")


def test_process_names_are_unique_and_can_stand_in_a_key() -> None:
    roles = set()
    for name in ("full-2oo3", "regional"):
        train = load_train(ROOT / "deploy" / "trains" / f"{name}.yaml")
        listed = processes(train, live=True)
        assert len({process.name for process in listed}) == len(listed)
        for process in listed:
            assert process.name == process_name(process.role, process.unit)
            assert BY_NAME["health"].key_for(train.name, process.name).count("/") == 4
        roles |= {process.role for process in listed}
    assert roles == set(ROLES)


def test_contract_and_estimator_have_the_same_common_states() -> None:
    assert tuple(COMMON) == tuple(COMMON_STATES)
