"""The figures of a run and of a cell, worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from milepost.campaign.aggregate import aggregate, quantile, violated
from milepost.campaign.cells import Cell
from milepost.campaign.epoch import Spell
from milepost.campaign.measure import measure
from milepost.campaign.task import Task
from milepost.campaign.watch import Said, Seen, Watch

UNITS = ["radar", "loop", "balise-reader"]
LIAR = Spell("radar", 1.0, 2.0)


def seen(position_m: float, half_m: float = 1.0, status: str = "normal", excluded: Any = (), **more: Any) -> Seen:
    fields: dict[str, Any] = {"speed_mps": 10.0, "speed_min_mps": 9.5, "speed_max_mps": 10.5, "reset_m": None, "since_m": 0.0}
    fields |= {"position_m": position_m, "position_min_m": position_m - half_m, "position_max_m": position_m + half_m}
    return Seen(**{**fields, "status": status, "excluded": tuple((unit, "why") for unit in excluded), **more})


def watch(*errors_m: float, states: dict[int, dict[str, Any]] | None = None) -> Watch:
    """Epochs every half second at 10 m/s, with these errors of the position."""
    out = Watch()
    for number, error_m in enumerate(errors_m):
        t_s = number / 2.0
        out.truth[t_s] = 10.0 * t_s, 10.0
        out.states[t_s] = seen(10.0 * t_s + error_m, **(states or {}).get(number, {}))
    return out


def test_epochs_outside_count_from_the_onset_on() -> None:
    #             before    during    after
    run = watch(5.0, 0.0, 0.5, 2.0, -3.0, 0.0, 0.0, states={4: {"status": "degraded"}})
    figures = measure(run, [LIAR], 0.0, UNITS)
    assert (figures["epochs"], figures["outside_before_onset_epochs"]) == (5, 1)
    assert (figures["outside_epochs"], figures["outside_position_epochs"], figures["outside_speed_epochs"]) == (2, 2, 0)
    assert (figures["normal_while_outside_epochs"], figures["first_outside_s"]) == (1, 1.5)
    assert figures["statuses_epochs"] == {"degraded": 1, "normal": 4}
    assert figures["observed_s"] == 2.5


def test_errors_during_a_fault_and_after_it_are_apart() -> None:
    figures = measure(watch(5.0, 0.0, 0.5, -2.0, -3.0, 0.25), [LIAR], 0.0, UNITS)
    assert (figures["position_error_during_max_m"], figures["position_error_after_max_m"]) == (2.0, 3.0)
    endless = measure(watch(0.0, 0.0, 1.0), [LIAR._replace(to_s=math.inf)], 0.0, UNITS)
    assert (endless["position_error_during_max_m"], endless["position_error_after_max_m"]) == (1.0, None)


def test_a_true_speed_outside_its_interval_is_a_violation() -> None:
    run = watch(0.0, 0.0, 0.0, states={2: {"speed_min_mps": 10.1}})
    figures = measure(run, [LIAR], 0.0, UNITS)
    assert (figures["outside_epochs"], figures["outside_position_epochs"], figures["outside_speed_epochs"]) == (1, 0, 1)


def test_half_widths_and_the_limit_of_subset_041() -> None:
    wide = {"half_m": 6.0}
    run = watch(0.0, 0.0, 0.0, 0.0, states={1: {**wide, "since_m": 19.0}, 2: {**wide, "since_m": 21.0}, 3: {"half_m": 4.0}})
    figures = measure(run, [], 0.0, UNITS)
    assert (figures["position_half_width_median_m"], figures["position_half_width_max_m"]) == (5.0, 6.0)
    assert figures["speed_half_width_median_mps"] == 0.5
    # 5 m + 5 % of 19 m is 5.95 m, of 21 m 6.05 m
    assert (figures["subset_041_epochs"], figures["subset_041_due_epochs"]) == (3, 4)


def test_the_share_of_subset_041_is_that_of_the_check() -> None:
    wide = {"half_m": 6.0}
    known = {**wide, "since_m": 0.0, "location_accuracy_m": 1.1}
    run = watch(*[0.0] * 4, states={0: {**wide, "since_m": None}, 1: known, 2: {**wide}, 3: {"status": "lost"}})
    figures = measure(run, [], 0.0, UNITS)
    # before the first balise nothing is asked for; a lost state is not permitted, however narrow it is
    assert (figures["subset_041_epochs"], figures["subset_041_due_epochs"]) == (1, 3)
    assert aggregate(Cell("maglev", (), "no fault", (task(1),)), [figures])["subset_041_percent"] == pytest.approx(100.0 / 3.0)


def test_a_unit_that_says_nothing_is_not_wrongly_excluded() -> None:
    states = {3: {"excluded": ["loop"], "unheard": ("loop",)}, 4: {"excluded": ["loop"]}}
    figures = measure(watch(*[0.0] * 6, states=states), [LIAR], 0.0, UNITS)
    assert (figures["wrongly_excluded_epochs"], figures["wrong_exclusions"]) == (1, 1)


def test_detection_is_the_first_exclusion_since_the_onset() -> None:
    run = watch(*[0.0] * 8, states={4: {"excluded": ["radar"]}, 5: {"excluded": ["radar"]}})
    assert measure(run, [LIAR], 0.0, UNITS)["time_to_detect_s"] == 1.0
    assert measure(run, [LIAR, Spell("loop", 1.0, 2.0)], 0.0, UNITS)["time_to_detect_s"] is None


def test_a_liar_that_is_in_use_again_while_it_lies_is_counted() -> None:
    """From its first exclusion to the end of its fault; what it does after that, and before it was found, is something else."""
    out = {"excluded": ["radar"]}
    run = watch(*[0.0] * 10, states={4: out, 6: out})
    #                          found at 2 s, in use again at 2.5, 3.5 and 4 s
    figures = measure(run, [LIAR._replace(to_s=4.25)], 0.0, UNITS)
    assert (figures["found_epochs"], figures["used_again_epochs"]) == (5, 3)
    cell = aggregate(
        Cell("maglev", ("radar",), "bias", (task(1), task(2))), [figures, measure(watch(*[0.0] * 10), [LIAR], 0.0, UNITS)]
    )
    assert cell["used_again_percent"] == 60.0
    never = aggregate(Cell("maglev", ("radar",), "bias", (task(1),)), [measure(watch(*[0.0] * 10), [LIAR], 0.0, UNITS)])
    assert never["used_again_percent"] is None


def test_a_liar_that_is_doubted_is_not_yet_detected() -> None:
    run = watch(*[0.0] * 8, states={3: {"doubted": ("loop",)}, 4: {"doubted": ("radar", "loop")}})
    figures = measure(run, [LIAR], 0.0, UNITS)
    assert (figures["time_to_detect_s"], figures["time_to_doubt_s"]) == (None, 1.0)
    assert figures["wrongly_excluded_epochs"] == 0


def test_a_readers_time_to_detect_runs_from_its_next_telegram() -> None:
    run = watch(*[0.0] * 8, states={5: {"excluded": ["balise-reader"]}})
    run.telegrams += [(0.5, "balise-reader"), (2.25, "balise-reader")]
    run.said.append(Said(2.3, "balise", "refused", "balise-reader says what is not there"))
    figures = measure(run, [Spell("balise-reader", 1.0, math.inf)], 0.0, UNITS)
    assert (figures["time_to_detect_s"], figures["time_to_warn_s"]) == (0.25, 0.05)
    assert figures["events"] == {"balise: refused": 1}


def test_innocents_are_counted_with_their_reasons() -> None:
    out = {"excluded": ["radar", "loop"]}
    run = watch(*[0.0] * 6, states={0: out, 2: out, 3: out, 5: out})
    figures = measure(run, [LIAR], 0.0, UNITS)
    # 4 epochs from the onset on, two innocents; the loop is out in three of them, at two times
    assert (figures["innocent_epochs"], figures["wrongly_excluded_epochs"], figures["wrong_exclusions"]) == (8, 3, 2)
    assert figures["wrongly_excluded"] == {"loop": {"epochs": 3, "reasons": ["why"]}}


def test_a_wheel_that_is_excluded_while_it_slips_is_not_wrongly_excluded() -> None:
    """Its exclusion counts for as long as it lasts, also from before the onset on; one that begins on a dry rail does not."""
    out = {"excluded": ["loop"]}
    run = watch(
        *[0.0] * 12, states={1: out, 2: out, 3: out, 5: out, 7: out, 8: out, 10: {"excluded": ["loop", "balise-reader"]}}
    )
    # epochs every half second: it slips at 0.5 s and at 3.5 s
    figures = measure(run, [LIAR], 0.0, UNITS, lambda unit, t_s: unit == "loop" and t_s in (0.5, 3.5))
    assert figures["wrongly_excluded"] == {
        "balise-reader": {"epochs": 1, "reasons": ["why"]},
        "loop": {"epochs": 2, "reasons": ["why"]},
    }
    assert (figures["wrongly_excluded_epochs"], figures["wrong_exclusions"], figures["innocent_epochs"]) == (3, 3, 20)


def test_a_liar_has_recovered_when_it_is_in_use_for_a_second() -> None:
    out = {"excluded": ["radar"]}
    run = watch(*[0.0] * 10, states={3: out, 4: out, 6: out})
    figures = measure(run, [LIAR], 0.0, UNITS)
    assert (figures["readmitted"], figures["time_to_recover_s"]) == (True, 1.5)
    never = measure(watch(*[0.0] * 6, states={3: out, 4: out}), [LIAR], 0.0, UNITS)
    assert (never["readmitted"], never["time_to_recover_s"]) == (False, None)
    assert measure(watch(*[0.0] * 6), [LIAR], 0.0, UNITS)["readmitted"] is None


def test_an_epoch_without_a_state_is_counted() -> None:
    run = watch(*[0.0] * 5)
    del run.states[1.5]
    assert measure(run, [LIAR], 0.0, UNITS)["epochs_without_state"] == 1


def test_a_quantile_counts_what_was_never_found() -> None:
    assert quantile([3.0, 1.0, None, 2.0], 0.5) == 2.0
    assert quantile([3.0, 1.0, None, 2.0], 0.75) == 3.0
    assert quantile([3.0, 1.0, None, 2.0], 0.95) is None
    assert quantile([], 0.5) is None


@given(st.lists(st.one_of(st.none(), st.floats(0.0, 1e6)), min_size=1), st.floats(0.01, 1.0))
def test_a_quantile_is_the_least_value_that_so_many_do_not_exceed(values: list[float | None], share: float) -> None:
    ordered = [math.inf if value is None else value for value in values]
    found = quantile(values, share)
    limit = math.inf if found is None else found
    assert sum(value <= limit for value in ordered) >= share * len(ordered) - 1e-6
    assert sum(value < limit for value in ordered) < share * len(ordered)


def task(seed: int) -> Task:
    return Task("maglev", "maglev", 4.0, 1.0, seed, "inputs", "code", {}, ({"unit": "radar", "kind": "bias"},), ("bias",))


def test_a_cell_is_its_runs_together() -> None:
    found = {"excluded": ["radar"]}
    runs = [
        measure(watch(*[0.0] * 6, states={3: found, 4: {"excluded": ["loop"]}}), [LIAR], 0.0, UNITS),
        measure(watch(0.0, 0.0, 4.0, 0.0, 0.0, 0.0, states={4: found}), [LIAR], 0.0, UNITS),
        {"crashed": "ValueError: no"},
    ]
    cell = aggregate(Cell("maglev", ("radar",), "bias", tuple(task(seed) for seed in (1, 2, 3))), runs)
    assert (cell["runs"], cell["crashed_runs"], cell["violation_runs"], cell["violation_epochs"]) == (3, 1, 1, 1)
    assert cell["violation_epochs_percent"] == 12.5
    assert (cell["detected_percent"], cell["time_to_detect_p50_s"], cell["time_to_detect_p95_s"]) == (100.0, 0.5, 1.0)
    # 1 of 2 · 4 epochs · 2 innocents; 4 s observed in all
    assert (cell["wrongly_excluded_percent"], cell["wrongly_excluded_runs"]) == (6.25, 1)
    assert cell["wrong_exclusions_per_h"] == pytest.approx(900.0)
    assert cell["wrongly_excluded"] == {"loop": {"percent": 12.5, "runs": 1, "reasons": ["why"]}}
    assert (cell["position_error_during_max_m"], cell["position_error_after_max_m"]) == (4.0, 0.0)
    assert [(run["seed"], run.get("crashed")) for run in cell["failed_runs"]] == [(2, None), (3, "ValueError: no")]
    assert violated(cell)


def test_where_nobody_lies_there_is_nothing_to_detect() -> None:
    runs = [measure(watch(*[0.0] * 6, states={3: {"excluded": ["loop"]}}), [], 0.0, UNITS)]
    cell = aggregate(Cell("maglev", (), "no fault", (task(1),)), runs)
    assert (cell["detected_percent"], cell["time_to_detect_p50_s"], cell["violation_runs"]) == (None, None, 0)
    assert cell["wrong_exclusions_per_h"] == pytest.approx(1200.0)


def test_a_cell_whose_runs_all_crashed_has_figures_of_none() -> None:
    cell = aggregate(Cell("maglev", ("radar",), "bias", (task(1),)), [{"crashed": "ValueError: no"}])
    assert violated(cell)
    assert (cell["violation_runs"], cell["detected_percent"], cell["position_half_width_max_m"]) == (0, None, None)
