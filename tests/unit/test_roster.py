"""Who is due, missing, worth waiting for, in use or excluded, as the roster's documentation says."""

from __future__ import annotations

import pytest

from milepost.fusion.shares import FixedShares
from milepost.fusion.verdicts import Verdict
from milepost.nodes.roster import KEPT_TIMES, Roster
from milepost.nodes.unit_record import STALE_NS, UnitRow
from milepost.sensors.base import Pause

MS = 1_000_000
S = 1_000_000_000
DEADLINE = 15 * MS
SHARES = {"radar": 0.6, "wheel": 0.3, "loop": 0.1}


def saw(known: Roster, unit: str, at_ns: int, now_ns: int) -> None:
    """A reading that counts came."""
    known.arrived(unit, at_ns, now_ns)
    known.counted(unit, at_ns)


def roster(shares: dict[str, float] | None = None) -> Roster:
    """radar at 100 Hz, wheel at 50 Hz, a loop that is never due, a balise reader that no filter speaks for."""
    rows = [
        UnitRow("radar", 0, 10 * MS, True),
        UnitRow("wheel", 1, 20 * MS, True),
        UnitRow("loop", 2, None, True),
        UnitRow("balise-reader", 3, None, False),
    ]
    return Roster(rows, FixedShares(SHARES if shares is None else shares), DEADLINE)


def heard(**at: int) -> Roster:
    """A roster whose units were each heard once, on time."""
    known = roster()
    for unit, time in at.items():
        saw(known, unit, time, time + MS)
    return known


# missing -----------------------------------------------------------------------------------------------------------------


def test_a_unit_is_not_missing_before_its_first_reading() -> None:
    assert roster().missing(S) == []


@pytest.mark.parametrize(("epoch", "missing"), [(S, False), (S + 9 * MS, False), (S + 10 * MS, True), (S + 11 * MS, True)])
def test_a_unit_is_missing_from_when_its_next_reading_is_due(epoch: int, missing: bool) -> None:
    assert (heard(radar=S).missing(epoch) == ["radar"]) == missing


def test_a_reading_is_due_after_its_units_own_period() -> None:
    known = heard(radar=S, wheel=S)
    assert known.missing(S + 10 * MS) == ["radar"]
    assert known.missing(S + 20 * MS) == ["radar", "wheel"]


def test_an_aperiodic_unit_is_never_due() -> None:
    assert heard(loop=S).missing(S + 500 * MS) == []


def test_a_unit_that_was_heard_again_is_no_longer_missing() -> None:
    known = heard(radar=S)
    saw(known, "radar", S + 20 * MS, S + 21 * MS)
    assert known.missing(S + 20 * MS) == []


def test_an_older_reading_that_comes_later_does_not_make_a_unit_missing() -> None:
    known = heard(radar=S)
    saw(known, "radar", S - 10 * MS, S + 2 * MS)
    assert known.missing(S + 9 * MS) == []
    assert known.missing(S + 10 * MS) == ["radar"]


def test_a_stale_unit_is_not_missing_but_excluded() -> None:
    known = heard(radar=S)
    assert known.missing(S + STALE_NS) == ["radar"]
    assert known.missing(S + STALE_NS + 1) == []
    assert known.at(S + STALE_NS, live=True, verdicts={}).excluded["wheel"] == "never heard"
    assert "radar" not in known.at(S + STALE_NS, live=True, verdicts={}).excluded
    assert known.at(S + STALE_NS + 1, live=True, verdicts={}).excluded["radar"] == "silent"


def test_a_slow_unit_is_stale_only_after_three_periods() -> None:
    known = Roster([UnitRow("gnss", 0, S, True)], FixedShares({}), DEADLINE)
    saw(known, "gnss", 10 * S, 10 * S)
    assert known.missing(13 * S) == ["gnss"]
    assert known.at(13 * S, live=True, verdicts={}).excluded == {}
    assert known.missing(13 * S + 1) == []
    assert known.at(13 * S + 1, live=True, verdicts={}).excluded == {"gnss": "silent"}


def test_a_unit_that_may_pause_is_stale_later_only_where_the_train_hardly_moves() -> None:
    """A loop at a stop says something once a window: by hand, 1.8 s and 50 ms after the last reading is not yet silence."""
    known = Roster([UnitRow("loop", 0, 50 * MS, True, pause=Pause(1.8, 0.5))], FixedShares({}), DEADLINE)
    saw(known, "loop", 10 * S, 10 * S)
    assert known.at(10 * S + 1850 * MS, live=True, verdicts={}, speed_mps=-0.49).excluded == {}
    assert known.at(10 * S + 1850 * MS + 1, live=True, verdicts={}, speed_mps=-0.49).excluded == {"loop": "silent"}
    assert known.at(11 * S, live=True, verdicts={}, speed_mps=0.5).excluded == {}
    assert known.at(11 * S + 1, live=True, verdicts={}, speed_mps=0.5).excluded == {"loop": "silent"}


# worth waiting for ---------------------------------------------------------------------------------------------------------


def test_a_unit_that_missed_a_deadline_is_awaited_once_punctual_again() -> None:
    known = heard(radar=S, wheel=S)
    missing = known.missing(S + 20 * MS)
    assert known.awaited(missing) == ["radar", "wheel"]
    known.missed_deadline("radar")
    assert known.awaited(missing) == ["wheel"]
    # late by one nanosecond more than the deadline: still not
    saw(known, "radar", S + 10 * MS, S + 10 * MS + DEADLINE + 1)
    assert known.awaited(["radar"]) == []
    saw(known, "radar", S + 20 * MS, S + 20 * MS + DEADLINE)
    assert known.awaited(["radar"]) == ["radar"]


def test_a_late_reading_alone_does_not_make_a_unit_unpunctual() -> None:
    known = heard(radar=S)
    saw(known, "radar", S + 10 * MS, S + 10 * MS + 10 * DEADLINE)
    assert known.awaited(["radar"]) == ["radar"]


@pytest.mark.parametrize("process", ["sensor-radar", "filter-radar"])
def test_a_unit_is_awaited_only_while_its_sensor_and_filter_are_alive(process: str) -> None:
    other = {"sensor-radar": "filter-radar", "filter-radar": "sensor-radar"}[process]
    known = heard(radar=S)
    known.process_alive(process, False)
    known.process_alive(other, True)
    assert known.awaited(["radar"]) == []
    known.process_alive(other, False)
    known.process_alive(process, True)
    assert known.awaited(["radar"]) == []
    known.process_alive(other, True)
    assert known.awaited(["radar"]) == ["radar"]


def test_tokens_of_other_processes_change_nothing() -> None:
    known = heard(radar=S, wheel=S)
    for process in ("sensor-wheel", "filter-wheel", "balise", "fuser", "radar", "sensor-radar-2", "world"):
        known.process_alive(process, False)
    assert known.awaited(["radar", "wheel"]) == ["radar"]


# late ---------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("untimely", [False, True])
@pytest.mark.parametrize(("behind_ns", "reason"), [(3 * S, "late"), (-S, "stamped ahead of time"), (MS, "silent")])
def test_a_unit_that_is_heard_but_not_in_time_is_not_silent(behind_ns: int, reason: str, untimely: bool) -> None:
    known, now = heard(radar=S), 10 * S
    known.arrived("radar", now - behind_ns if untimely else S, now, untimely=untimely)
    expected = reason if untimely else "late"
    presence = known.at(now + MS, live=True, verdicts={})
    assert presence.excluded["radar"] == expected
    assert ("radar" in presence.behind_s) == (expected == "late")


def test_a_late_unit_of_which_nothing_comes_any_more_is_silent() -> None:
    known = heard(radar=S)
    known.arrived("radar", 2 * S, 10 * S)
    assert known.at(10 * S + STALE_NS, live=True, verdicts={}).excluded["radar"] == "late"
    assert known.at(10 * S + STALE_NS + 1, live=True, verdicts={}).excluded["radar"] == "silent"


def test_settled_states_do_not_depend_on_when_readings_came() -> None:
    known = heard(radar=S)
    known.arrived("radar", 2 * S, 10 * S, untimely=True)
    assert known.at(10 * S, live=False, verdicts={}).excluded["radar"] == "silent"


# in use and excluded -------------------------------------------------------------------------------------------------------


def test_units_in_use_have_the_age_of_their_last_observation_at_the_epoch() -> None:
    known = heard(radar=S, loop=S - 300 * MS)
    saw(known, "radar", S + 10 * MS, S + 11 * MS)
    assert dict(known.at(S + 5 * MS, live=True, verdicts={}).ages_s) == pytest.approx({"radar": 0.005, "loop": 0.305})
    assert dict(known.at(S + 15 * MS, live=True, verdicts={}).ages_s) == pytest.approx({"radar": 0.005, "loop": 0.315})


def test_observations_after_the_epoch_do_not_count_at_it() -> None:
    presence = heard(radar=S).at(S - 1, live=True, verdicts={})
    assert presence.excluded["radar"] == "never heard"
    assert "radar" not in presence.ages_s


def test_a_silent_units_share_goes_to_the_units_in_use() -> None:
    everyone = heard(radar=S, wheel=S, loop=S).at(S, live=True, verdicts={})
    assert dict(everyone.shares) == pytest.approx(SHARES)
    without_radar = heard(wheel=S, loop=S).at(S, live=True, verdicts={})
    assert dict(without_radar.shares) == pytest.approx({"wheel": 0.75, "loop": 0.25})
    assert set(without_radar.shares) == set(without_radar.ages_s)


def test_units_whose_shares_are_all_zero_share_evenly() -> None:
    known = roster({"radar": 1.0})
    saw(known, "wheel", S, S)
    saw(known, "loop", S, S)
    assert dict(known.at(S, live=True, verdicts={}).shares) == {"wheel": 0.5, "loop": 0.5}


def test_without_a_unit_in_use_there_are_no_shares() -> None:
    presence = roster().at(S, live=True, verdicts={})
    assert (dict(presence.ages_s), dict(presence.shares)) == ({}, {})
    assert dict(presence.excluded) == {"radar": "never heard", "wheel": "never heard", "loop": "never heard"}


def test_every_fused_unit_is_either_in_use_or_excluded() -> None:
    known = heard(radar=S, wheel=S - 5 * S)
    known.process_alive("sensor-loop", False)
    presence = known.at(S + MS, live=True, verdicts={})
    assert dict(presence.excluded) == {"wheel": "silent", "loop": "process gone"}
    assert set(presence.ages_s) == {"radar"}


def test_a_missing_token_excludes_a_unit_only_in_live_states() -> None:
    known = heard(radar=S)
    known.process_alive("filter-radar", False)
    assert known.at(S + MS, live=True, verdicts={}).excluded["radar"] == "process gone"
    settled = known.at(S + MS, live=False, verdicts={})
    assert "radar" not in settled.excluded
    assert "radar" in settled.shares


def test_a_balise_reader_is_excluded_only_when_its_token_is_missing() -> None:
    known = heard(radar=S)
    presence = known.at(S, live=True, verdicts={})
    assert "balise-reader" not in presence.excluded
    assert "balise-reader" not in presence.ages_s
    known.process_alive("sensor-balise-reader", False)
    assert known.at(S, live=True, verdicts={}).excluded["balise-reader"] == "process gone"
    assert "balise-reader" not in known.at(S, live=False, verdicts={}).excluded


# judged by the fuser, and refused by a filter ------------------------------------------------------------------------------


def test_a_gating_unit_is_excluded_at_once_with_its_reason() -> None:
    known = heard(radar=S, wheel=S)
    verdict = Verdict(None, S, S - 20 * MS, "sliding", "sliding")
    assert known.at(S, live=True, verdicts={"wheel": verdict}).excluded["wheel"] == "sliding"
    assert known.at(S + STALE_NS + 1, live=False, verdicts={"wheel": verdict}).excluded["wheel"] == "silent"


def test_a_unit_whose_readings_are_refused_is_excluded_with_the_last_reason() -> None:
    known = heard(radar=S)
    known.refused("radar", S + 900 * MS, "off_track")
    assert "radar" not in known.at(S + STALE_NS, live=False, verdicts={}).excluded
    assert known.at(S + STALE_NS + 1, live=False, verdicts={}).excluded["radar"] == "off_track"
    assert known.at(S + 900 * MS + STALE_NS + 1, live=False, verdicts={}).excluded["radar"] == "silent"


def test_a_reading_is_due_only_when_the_sensor_can_have_sent_it() -> None:
    """A mean over 50 ms is true at its middle and ready 25 ms later."""
    known = Roster([UnitRow("imu", 0, 50 * MS, True, 25 * MS)], FixedShares({}), DEADLINE)
    saw(known, "imu", S, S + 25 * MS)
    assert known.missing(S + 74 * MS) == []
    assert known.missing(S + 75 * MS) == ["imu"]


# forgetting ----------------------------------------------------------------------------------------------------------------


def test_forgetting_keeps_later_times_and_a_silent_units_last_time() -> None:
    known = roster()
    for k in range(10):
        saw(known, "radar", S + 10 * k * MS, S + 10 * k * MS)
    saw(known, "loop", S, S)
    epochs = [S + 50 * MS, S + 55 * MS, S + 90 * MS]
    before = [known.at(epoch, live=True, verdicts={}) for epoch in epochs]
    known.forget(S + 50 * MS)
    assert [known.at(epoch, live=True, verdicts={}) for epoch in epochs] == before
    assert known.at(S + 90 * MS, live=True, verdicts={}).ages_s["loop"] == pytest.approx(0.09)
    assert known.at(S + 20 * MS, live=True, verdicts={}).excluded["radar"] == "never heard"


def test_a_record_without_forgetting_stays_bounded() -> None:
    known = roster()
    for k in range(3 * KEPT_TIMES):
        saw(known, "radar", S + k * MS, S + k * MS)
    end = S + (3 * KEPT_TIMES - 1) * MS
    assert known.at(end, live=True, verdicts={}).ages_s["radar"] == 0.0
    assert known.at(end - (KEPT_TIMES - 2) * MS, live=True, verdicts={}).ages_s["radar"] == 0.0
    assert known.at(S, live=True, verdicts={}).excluded["radar"] == "never heard"
