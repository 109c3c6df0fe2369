"""Which of two fusers speaks, by hand: epochs of 20 ms, a deadline of 15 ms; a leader is silent after 80 ms."""

from __future__ import annotations

from itertools import pairwise

import pytest

from milepost.nodes.standby.lead import Lead
from milepost_schemas import FusedState, SensorInUse

MS = 1_000_000
NAMES = ["fuser", "fuser-2"]


def lead(unit: str, other_alive: bool = True) -> Lead:
    out = Lead(unit, NAMES, 20 * MS, 15 * MS)
    if other_alive:
        out.alive(NAMES[1 - NAMES.index(unit)], True)
    return out


def state(unit: str, epoch_ms: int, units: int = 2) -> FusedState:
    sensors = [SensorInUse(unit=f"u{n}", share=1.0 / units, age_s=0.0) for n in range(units)]
    at = {"measured_at_ns": epoch_ms * MS, "published_at_ns": (epoch_ms + 5) * MS}
    return FusedState.model_construct(unit=unit, **at, sensors=sensors)


def test_one_that_has_just_begun_listens_first() -> None:
    """The other's token may not have come yet."""
    new = lead("fuser", other_alive=False)
    assert [new.takes_over(t * MS) for t in (0, 79, 80)] == [False, False, True]


def test_of_two_that_are_stopped_again_and_again_one_speaks_all_the_same() -> None:
    """GIVEN a machine so busy that each is away for more than the lease, over and over, THEN the train does not fall silent."""
    pair = [lead("fuser"), lead("fuser-2")]
    spoken = []
    for t in range(0, 30_000, 600):
        for each in pair:
            each.awake(t * MS, 600 * MS)
            each.publishes((t - 1000) * MS, t * MS)
            if each.takes_over(t * MS):
                spoken.append(t)
    assert max(b - a for a, b in pairwise([0, *spoken, 30_000])) <= 6000


def test_of_two_that_are_held_up_again_and_again_one_speaks_while_others_are_heard() -> None:
    """GIVEN a machine so busy that each works every 0.1 s only and says all late, THEN one of them speaks, and keeps on.

    Each holds itself for held up, and does not know what was said meanwhile; but it hears others that are no replicas.
    """
    first, second = lead("fuser"), lead("fuser-2")
    spoken: dict[str, list[int]] = {"fuser": [], "fuser-2": []}
    for t in range(1000, 6000, 50):
        one, other, unit = (first, second, "fuser") if t % 100 == 0 else (second, first, "fuser-2")
        one.awake(t * MS, 100 * MS)
        one.heard((t - 20) * MS)
        one.publishes((t - 200) * MS, t * MS)
        if one.takes_over(t * MS):
            spoken[unit].append(t)
            other.spoke(state(unit, t - 200), 2, (t + 20) * MS)
    assert spoken["fuser-2"] == []
    assert max(b - a for a, b in pairwise([1000, *spoken["fuser"], 6000])) <= 500


def test_one_that_speaks_because_nobody_did_gives_way_to_another_that_is_heard() -> None:
    late = lead("fuser-2")
    late.awake(1000 * MS)
    late.spoke(state("fuser", 1000), 2, 1000 * MS)
    for t in range(1100, 1700, 100):
        late.awake(t * MS, 100 * MS)
        late.heard((t - 10) * MS)
        late.publishes((t - 200) * MS, t * MS)
        late.takes_over(t * MS)
    assert late.leads
    late.spoke(state("fuser", 1690), 2, 1700 * MS)
    assert not late.leads


def test_one_that_was_stopped_once_hears_first_whether_another_one_speaks() -> None:
    """However long it was stopped, the time does not count as one in which nobody spoke."""
    old = lead("fuser")
    old.leads = True
    for t in range(0, 100, 20):
        old.awake(t * MS)
        old.publishes((t - 10) * MS, t * MS)
    for t in range(60_000, 62_000, 20):
        old.awake(t * MS, 59_920 * MS if t == 60_000 else 20 * MS)
        assert not old.takes_over(t * MS)


def test_at_the_start_the_second_in_the_list_leaves_the_first_time_to_begin() -> None:
    """All processes of a train begin at once, and a busy machine needs longer for it than one epoch more."""
    first, second = lead("fuser"), lead("fuser-2")
    for each in (first, second):
        each.awake(1000 * MS)
    assert [first.takes_over(t * MS) for t in (1000, 1079, 1080)] == [False, False, True]
    assert [second.takes_over(t * MS) for t in (1000, 1599, 1600)] == [False, False, True]


def test_one_that_was_handed_what_another_knows_listens_half_a_second() -> None:
    """Who handed it over runs, and may speak; what it says has not come yet."""
    back = lead("fuser")
    back.joins(1000 * MS)
    back.awake(1010 * MS)
    assert [back.takes_over(t * MS) for t in (1010, 1579, 1580)] == [False, False, True]
    other = lead("fuser")
    other.joins(1000 * MS)
    other.awake(1010 * MS)
    other.spoke(state("fuser-2", 1000), 2, 1020 * MS)
    assert [other.takes_over(t * MS) for t in (1084, 1085)] == [False, True]


def test_one_that_listens_speaks_at_once_where_the_other_has_ended() -> None:
    back = lead("fuser")
    back.joins(1000 * MS)
    back.awake(1010 * MS)
    back.alive("fuser-2", False)
    assert back.takes_over(1011 * MS)


def test_one_that_begins_beside_a_leader_that_is_then_killed_waits_no_longer_than_another_one() -> None:
    second = lead("fuser-2")
    second.awake(1000 * MS)
    second.spoke(state("fuser", 1000), 2, 1010 * MS)
    assert [second.takes_over(t * MS) for t in (1104, 1105)] == [False, True]


def test_with_long_epochs_three_of_them_are_silence() -> None:
    slow = Lead("fuser", NAMES, 100 * MS, 15 * MS)
    slow.alive("fuser-2", True)
    assert [slow.takes_over(t * MS) for t in (0, 299, 300)] == [False, False, True]


def test_a_standby_that_hears_the_leader_does_not_lead() -> None:
    standby = lead("fuser-2")
    for t in range(0, 1000, 20):
        standby.spoke(state("fuser", t), 2, t * MS)
        assert not standby.takes_over((t + 19) * MS)


def test_a_standby_leads_where_others_are_heard_for_so_long_after_the_leader() -> None:
    standby = lead("fuser-2")
    standby.spoke(state("fuser", 100), 2, 105 * MS)
    found = []
    for t in (204, 205):
        standby.heard(t * MS)
        found.append(standby.takes_over(t * MS))
    assert found == [False, True]


def test_where_nobody_at_all_is_heard_the_leader_is_not_the_one_that_is_silent() -> None:
    """As where the router was stopped: what the leader said comes with all the rest. Half a second decides."""
    standby = lead("fuser-2")
    standby.spoke(state("fuser", 100), 2, 105 * MS)
    standby.heard(110 * MS)
    assert [standby.takes_over(t * MS) for t in (205, 400, 609, 610)] == [False, False, False, True]


def test_what_a_standby_has_not_read_yet_is_no_silence() -> None:
    """Its own inbox was full: the leader may have spoken since."""
    standby = lead("fuser-2")
    standby.spoke(state("fuser", 100), 2, 105 * MS)
    standby.heard(300 * MS)
    assert not standby.takes_over(300 * MS, behind_ns=100 * MS)
    assert standby.takes_over(300 * MS, behind_ns=90 * MS)


def test_a_standby_leads_at_once_where_the_leader_has_ended() -> None:
    standby = lead("fuser-2")
    standby.spoke(state("fuser", 100), 2, 105 * MS)
    standby.alive("fuser", False)
    assert standby.takes_over(106 * MS)


def test_other_processes_may_come_and_go() -> None:
    standby = lead("fuser-2")
    standby.spoke(state("fuser", 100), 2, 105 * MS)
    standby.alive("filter-radar", True)
    standby.alive("filter-radar", False)
    assert not standby.takes_over(106 * MS)


def leading(unit: str) -> Lead:
    out = lead(unit, other_alive=False)
    assert [out.takes_over(t * MS) for t in (0, 120)][-1]
    out.alive(NAMES[1 - NAMES.index(unit)], True)
    return out


def test_a_leader_that_was_stopped_gives_way_until_nobody_else_speaks() -> None:
    """56 ms without a step: another one may speak soon. It listens for 80 ms from when it is sure to be awake."""
    old = leading("fuser")
    old.awake(1056 * MS, 56 * MS)
    assert old.leads
    old.awake(1113 * MS, 57 * MS)
    assert not old.leads
    assert [old.takes_over(t * MS) for t in (1113, 1249, 1250)] == [False, False, True]


def woken(unit: str) -> Lead:
    """A leader that was stopped for two seconds, and is told that nobody else is there: its connection is lost."""
    out = leading(unit)
    out.awake(3000 * MS, 2000 * MS)
    out.alive(NAMES[1 - NAMES.index(unit)], False)
    return out


def test_a_leader_that_was_stopped_for_long_does_not_speak_before_it_is_connected_again() -> None:
    old = woken("fuser")
    # what lay in its queue tells nothing of now
    old.spoke(state("fuser-2", 1500), 2, 3010 * MS)
    old.alive("fuser-2", False)
    assert not any(old.takes_over(t * MS) for t in range(3010, 4900, 10))
    old.alive("fuser-2", True)
    assert not any(old.takes_over(t * MS) for t in range(4900, 5300, 10))
    old.spoke(state("fuser-2", 5300), 2, 5310 * MS)
    assert not old.takes_over(5360 * MS)


def test_a_leader_that_was_stopped_for_long_speaks_again_where_the_other_is_silent() -> None:
    old = woken("fuser")
    old.alive("fuser-2", True)
    assert [old.takes_over(t * MS) for t in (3400, 3899, 3900)] == [False, False, True]


def test_a_leader_that_was_stopped_for_long_and_is_alone_speaks_after_two_seconds() -> None:
    old = woken("fuser")
    assert [old.takes_over(t * MS) for t in (3000, 4999, 5000)] == [False, False, True]


def test_a_leader_that_was_stopped_for_long_does_not_count_the_stop_as_time_to_connect() -> None:
    """Its time follows what was waiting at first, and leaps with the first reading over a new connection, before any token."""
    old = leading("fuser")
    old.awake(1010 * MS, 2200 * MS)
    old.alive("fuser-2", False)
    old.awake(3260 * MS, 50 * MS)
    assert not old.takes_over(3260 * MS)
    old.alive("fuser-2", True)
    assert [old.takes_over(t * MS) for t in (3270, 3769, 3770)] == [False, False, True]


def test_a_state_that_lay_in_its_queue_does_not_tell_a_stopped_leader_that_it_is_connected() -> None:
    """Its time follows what was waiting, so that what another one said meanwhile looks new, until it has caught up."""
    old = leading("fuser")
    old.awake(1270 * MS, 2100 * MS)
    old.spoke(state("fuser-2", 1260), 2, 1270 * MS)
    old.alive("fuser-2", False)
    assert not old.takes_over(1280 * MS)
    old.awake(3180 * MS, 20 * MS)
    assert not old.takes_over(3180 * MS)
    old.alive("fuser-2", True)
    old.spoke(state("fuser-2", 3180), 2, 3190 * MS)
    assert [old.takes_over(t * MS) for t in (3264, 3265)] == [False, True], "now it waits no longer than another one"


def test_one_that_kept_its_connection_through_a_stop_gives_way_as_ever() -> None:
    """No token comes where none had gone."""
    second = leading("fuser-2")
    second.awake(1600 * MS, 600 * MS)
    for t in range(1600, 3740, 20):
        second.awake(t * MS, 20 * MS)
    assert [second.takes_over(t * MS) for t in (3749, 3750)] == [False, True], "nobody spoke, not even the first in the list"
    second.spoke(state("fuser", 3750), 2, 3760 * MS)
    assert not second.leads


def test_a_leader_that_is_late_with_an_epoch_gives_way() -> None:
    slow = leading("fuser")
    slow.publishes(1000 * MS, 1075 * MS)
    assert slow.leads
    slow.publishes(1020 * MS, 1096 * MS)
    assert not slow.leads


def test_alone_a_late_one_goes_on() -> None:
    alone = lead("fuser", other_alive=False)
    assert [alone.takes_over(t * MS) for t in (0, 100)][-1]
    alone.publishes(1000 * MS, 2000 * MS)
    assert alone.leads


def test_of_two_leaders_the_later_in_the_list_gives_way() -> None:
    first, second = leading("fuser"), leading("fuser-2")
    first.spoke(state("fuser-2", 1000), 2, 1010 * MS)
    second.spoke(state("fuser", 1000), 2, 1010 * MS)
    assert (first.leads, second.leads) == (True, False)


def test_of_two_leaders_the_one_that_was_cut_off_gives_way_and_does_not_come_back() -> None:
    """It heard no unit; the other one did."""
    cut, whole = leading("fuser"), leading("fuser-2")
    whole.spoke(state("fuser", 1000, units=1), 4, 1010 * MS)
    cut.spoke(state("fuser-2", 1000, units=4), 1, 1010 * MS)
    assert (cut.leads, whole.leads) == (False, True)
    cut.spoke(state("fuser-2", 1020, units=4), 4, 1030 * MS)
    assert not cut.takes_over(1040 * MS)


def test_old_states_of_another_change_nothing() -> None:
    second = leading("fuser-2")
    second.spoke(state("fuser", 1000), 4, 1100 * MS)
    assert second.leads


def test_a_leader_that_takes_itself_to_be_alone_gives_way_to_one_that_it_hears() -> None:
    """Tokens may come later than states, after a connection was lost: who speaks is there."""
    second = lead("fuser-2")
    second.alive("fuser", False)
    assert second.takes_over(1000 * MS)
    second.spoke(state("fuser", 1000), 2, 1010 * MS)
    assert not second.takes_over(1020 * MS)
    second.alive("fuser", False)
    assert second.takes_over(1030 * MS)


def stopped_standby(stopped_ms: int) -> Lead:
    """A standby that hears the leader until 1000 ms, and is then stopped for so long."""
    out = lead("fuser-2")
    for t in range(0, 1001, 20):
        out.awake(t * MS, 20 * MS)
        out.spoke(state("fuser", t - 5), 2, t * MS)
    out.awake((1000 + stopped_ms) * MS, stopped_ms * MS)
    return out


def test_a_standby_that_lost_its_connection_in_a_stop_shorter_than_the_lease_hears_first_whether_the_leader_speaks() -> None:
    """Its last sign of life was up to a quarter of the lease old: the others' tokens go and come, though nobody has ended."""
    standby = stopped_standby(400)
    standby.alive("fuser", False)
    assert not any(standby.takes_over(t * MS) for t in range(1400, 1500, 10))
    standby.alive("fuser", True)
    standby.spoke(state("fuser", 1510), 2, 1515 * MS)
    standby.heard(2000 * MS)
    assert [standby.takes_over(t * MS) for t in (1999, 2000)] == [False, True], "the leader is silent afterwards"


def test_after_a_stop_the_leaders_states_may_come_last() -> None:
    """All that others said in half a second is heard before the leader's first state: it is asked for over a new connection."""
    standby = stopped_standby(480)
    for t in range(1000, 1700, 20):
        standby.heard(t * MS)
        assert not standby.takes_over(max(t, 1480) * MS)
    standby.spoke(state("fuser", 1690), 2, 1700 * MS)
    assert not standby.takes_over(1700 * MS)


def test_the_state_that_it_took_when_it_was_stopped_does_not_tell_a_standby_that_it_is_connected() -> None:
    """A turn keeps the time at which it began, so that the state looks new; readings come over the new connection first."""
    standby = stopped_standby(540)
    standby.spoke(state("fuser", 995), 2, 1000 * MS)
    standby.alive("fuser", False)
    standby.alive("fuser", True)
    standby.heard(1590 * MS)
    assert not standby.takes_over(1590 * MS)


def test_a_standby_that_was_stopped_for_a_moment_leads_soon_where_the_leader_has_ended_meanwhile() -> None:
    """It cannot tell at first whether the leader has ended or its own connection: it listens for half a second."""
    standby = stopped_standby(400)
    standby.alive("fuser", False)
    assert [standby.takes_over(t * MS) for t in (1400, 1899, 1900)] == [False, False, True]


def test_a_standby_whose_stop_is_over_for_long_leads_at_once_where_the_leader_has_ended() -> None:
    standby = stopped_standby(400)
    for t in range(1420, 1901, 20):
        standby.awake(t * MS, 20 * MS)
        standby.spoke(state("fuser", t - 5), 2, t * MS)
    standby.alive("fuser", False)
    assert standby.takes_over(1901 * MS)


@pytest.mark.parametrize(("stopped_ms", "awake_ms"), [(300, 20), (300, 100), (450, 100)])
def test_of_two_that_are_stopped_together_again_and_again_one_speaks(stopped_ms: int, awake_ms: int) -> None:
    """GIVEN a machine so busy that both stand still over and over, THEN they listen once: the first speaks, and goes on."""
    pair = {"fuser": leading("fuser"), "fuser-2": lead("fuser-2")}
    for each in pair.values():
        each.awake(1000 * MS, 20 * MS)
    pair["fuser"].publishes(990 * MS, 1000 * MS)
    pair["fuser-2"].spoke(state("fuser", 990), 2, 1000 * MS)
    spoken: dict[str, list[int]] = {name: [] for name in NAMES}
    for begun in range(1000 + stopped_ms, 12_000, stopped_ms + awake_ms):
        for t in range(begun, begun + awake_ms, 10):
            said = []
            for name, each in pair.items():
                each.awake(t * MS, (10 if t > begun else stopped_ms) * MS)
                each.heard((t - 5) * MS)
                each.publishes((t - 10 if t > begun else t - stopped_ms) * MS, t * MS)
                if each.takes_over(t * MS):
                    spoken[name].append(t)
                    said.append(name)
            for name in said:
                pair[NAMES[1 - NAMES.index(name)]].spoke(state(name, t - 10), 2, (t + 5) * MS)
    assert spoken["fuser-2"] == []
    # half a second to listen, 0.3 s in which no replica is heard, and the stop in which that is over
    assert spoken["fuser"][0] <= 1000 + stopped_ms + 800 + stopped_ms + awake_ms
    assert max(b - a for a, b in pairwise(spoken["fuser"])) <= stopped_ms + 10


def test_of_two_that_were_stopped_for_long_together_one_speaks() -> None:
    """As where a machine was paused and their connections were kept: both wait, the first in the list for a shorter time."""
    first, second = leading("fuser"), lead("fuser-2")
    for each in (first, second):
        each.awake(1000 * MS, 20 * MS)
        each.awake(1600 * MS, 600 * MS)
    assert [first.takes_over(t * MS) for t in (3599, 3600)] == [False, True]
    assert not second.takes_over(3600 * MS)
    second.spoke(state("fuser", 3590), 2, 3601 * MS)
    assert not second.takes_over(3620 * MS)


def test_a_standby_listens_from_when_it_is_connected_again() -> None:
    """Its new connection may take most of the time in which it listens; the leader's first state comes later."""
    standby = stopped_standby(400)
    standby.alive("fuser", False)
    standby.awake(1850 * MS, 20 * MS)
    standby.alive("fuser", True)
    standby.heard(2300 * MS)
    assert not standby.takes_over(2300 * MS)


def test_a_token_that_comes_before_the_time_has_caught_up_shortens_no_listening() -> None:
    """The time follows what was waiting: half a second after the token is before the end of the stop."""
    standby = stopped_standby(0)
    standby.awake(1010 * MS, 450 * MS)
    standby.alive("fuser", False)
    standby.alive("fuser", True)
    standby.awake(1600 * MS, 140 * MS)
    standby.heard(1890 * MS)
    assert not standby.takes_over(1890 * MS)


def test_where_epochs_are_long_others_are_heard_between_two_states() -> None:
    """Readings come every 20 ms, states every second: that is no silence."""
    slow = Lead("fuser-2", NAMES, 1000 * MS, 15 * MS)
    slow.alive("fuser", True)
    for t in range(1000, 5000, 20):
        slow.awake(t * MS, 20 * MS)
        slow.heard(t * MS)
        if t % 1000 == 0:
            slow.spoke(state("fuser", t - 5), 2, t * MS)
        assert not slow.takes_over(t * MS)


def test_where_epochs_are_long_the_wait_for_the_next_one_is_no_stop() -> None:
    slow = Lead("fuser-2", NAMES, 300 * MS, 15 * MS)
    slow.alive("fuser", True)
    for t in range(300, 3001, 300):
        slow.awake(t * MS, 300 * MS)
        slow.spoke(state("fuser", t - 5), 2, t * MS)
    slow.alive("fuser", False)
    assert slow.takes_over(3001 * MS)
