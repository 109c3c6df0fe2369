"""Golden runs: the same scenario gives the same states from one version to the next, unless somebody means otherwise."""

from __future__ import annotations

import json
from typing import Any

import pytest
from regenerate import GOLDEN, RUNS, missing_data, run

ADVICE = (
    "the settled states of {name} are no longer those of tests/replay/golden/{name}.json: {what}\n"
    "If that is meant, run `python tests/replay/regenerate.py` and add a line to CHANGELOG.md that says what changed and why."
)
# one unit in the sixth digit: another machine's last bit must not decide how a digit is rounded
TOLERANCE = 1.01e-5


def differences(golden: list[dict[str, Any]], now: list[dict[str, Any]]) -> list[str]:
    """What differs, in words."""
    if [state["t_s"] for state in golden] != [state["t_s"] for state in now]:
        return ["the epochs differ"]
    out = []
    for was, there in zip(golden, now, strict=True):
        if set(was) != set(there):
            return ["the fields differ"]
        for key, value in was.items():
            same = there[key] == pytest.approx(value, rel=TOLERANCE) if isinstance(value, float) else there[key] == value
            if not same:
                out.append(f"at {was['t_s']:g} s {key} was {value} and is {there[key]}")
    return out


@pytest.mark.parametrize("name", RUNS)
def test_a_golden_run_gives_the_states_it_gave_before(name):
    if lacking := missing_data(name):
        pytest.skip(lacking)
    golden = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))
    assert len(golden) == RUNS[name] // 5
    found = differences(golden, run(name))
    assert not found, ADVICE.format(name=name, what="; ".join(found[:5]))


@pytest.mark.parametrize("name", RUNS)
def test_a_state_that_differs_in_its_fifth_digit_is_noticed(name):
    golden = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))
    assert differences(golden, golden) == []
    for key in ("position_m", "speed_variance_m2ps2"):
        other = [*golden[:-1], {**golden[-1], key: golden[-1][key] * (1.0 + 5e-5)}]
        assert len(differences(golden, other)) == 1
    assert len(differences(golden, [*golden[:-1], {**golden[-1], "status": "lost"}])) == 1
    assert differences(golden, golden[:-1])


def test_every_golden_file_is_of_a_run():
    assert {path.stem for path in GOLDEN.glob("*.json")} == set(RUNS)
