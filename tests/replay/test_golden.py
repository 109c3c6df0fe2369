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


def same(was: Any, now: Any) -> bool:
    """Whether two values agree, floats to within the tolerance."""
    return now == pytest.approx(was, rel=TOLERANCE) if isinstance(was, float) else now == was


def same_private(was: dict[str, list[float]], now: dict[str, list[float]]) -> bool:
    """Whether private states agree; a mean near 0 to within a part of its standard deviation."""
    return set(was) == set(now) and all(
        now[name] == [pytest.approx(mean, rel=TOLERANCE, abs=TOLERANCE * variance**0.5), pytest.approx(variance, rel=TOLERANCE)]
        for name, (mean, variance) in was.items()
    )


def differences(golden: list[dict[str, Any]], now: list[dict[str, Any]]) -> list[str]:
    """What differs, in words."""
    if [state["t_s"] for state in golden] != [state["t_s"] for state in now]:
        return ["the epochs differ"]
    out = []
    for was, there in zip(golden, now, strict=True):
        if set(was) != set(there):
            return ["the fields differ"]
        out += [
            f"at {was['t_s']:g} s {key} was {value} and is {there[key]}"
            for key, value in was.items()
            if not (same_private(value, there[key]) if key == "private" else same(value, there[key]))
        ]
    return out


@pytest.mark.parametrize("name", RUNS)
def test_a_golden_run_gives_the_same_states(name):
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
    last = golden[-1]
    for key in ("position_m", "speed_variance_m2ps2"):
        assert len(differences(golden, [*golden[:-1], {**last, key: last[key] * (1.0 + 5e-5)}])) == 1
    assert len(differences(golden, [*golden[:-1], {**last, "status": "lost"}])) == 1
    assert differences(golden, golden[:-1])


@pytest.mark.parametrize(("name", "state"), [("metro", "odometer-1.scale"), ("full", "imu.bias"), ("full", "gnss.offset")])
def test_a_private_state_that_differs_is_noticed(name, state):
    golden = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))
    last = golden[-1]
    mean, variance = last["private"][state]
    for other in ([mean + 5e-5 * max(abs(mean), variance**0.5), variance], [mean, variance * (1.0 + 5e-5)]):
        changed = {**last, "private": {**last["private"], state: other}}
        assert differences(golden, [*golden[:-1], changed])
    less = {name: value for name, value in last["private"].items() if name != state}
    assert differences(golden, [*golden[:-1], {**last, "private": less}])


def test_every_golden_file_is_of_a_run():
    assert {path.stem for path in GOLDEN.glob("*.json")} == set(RUNS)
