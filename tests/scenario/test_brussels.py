"""The real train log: a minute of fixes withheld, and stretches in which the receiver coasts."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from harness import PERIOD_NS, ROOT, at

from examples import gnss_log
from milepost.config.scenario_file import ScenarioFile, load_scenario
from milepost.config.yaml_files import ConfigError
from milepost.evaluation.plan import make_plan
from milepost.evaluation.run_log import RunLog
from milepost.evaluation.scenario_run import run_plan
from milepost.evaluation.withheld import score_withheld, withheld_fixes
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.recordings.gnss_log import RecordedFix, read_gnss_log

SCENARIO = ROOT / "deploy/scenarios/brussels-28876.yaml"
LOG = ROOT.parent / "shared/data/brussels/log_28876_gnss.csv"
# five seconds after the withheld minute, so that all of it is settled
UNTIL_S = 345.0

pytestmark = [
    pytest.mark.skipif(not LOG.is_file(), reason="../shared/data/brussels, the recorded train logs, is not here"),
    pytest.mark.long,
]


@pytest.fixture(scope="module")
def journey() -> tuple[ScenarioFile, RunLog, list[RecordedFix]]:
    """The train until its withheld minute is over, on the scenario's seed."""
    scenario, train = load_scenario(SCENARIO)
    log = RunLog(train)
    simulate(train, UNTIL_S, log.tap, log.keep)
    return scenario, log, withheld_fixes(SCENARIO, scenario, train)


def stretches_without_rtk() -> list[tuple[float, float]]:
    """Where the receiver coasts: spans of at least two seconds between RTK fixes."""
    times = [fix.t_s for fix in read_gnss_log(gnss_log(LOG)) if fix.solution == "rtk_fixed"]
    return [(a, b) for a, b in pairwise(times) if b - a >= 2.0 and b < UNTIL_S]


def changed_scenario(folder: Path, **fields: Any) -> Path:
    """The scenario with some of its fields replaced."""
    file = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    file |= {"train": str(ROOT / "deploy/trains/brussels-28876.yaml"), **fields}
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(file), encoding="utf-8")
    return path


class TestWithheldMinute:
    def test_the_interval_holds_every_withheld_fix(self, journey):
        _, log, fixes = journey
        figures = score_withheld(log.settled, fixes, log.train.line, OFFLINE_START_NS, PERIOD_NS)
        assert figures["withheld_fixes"] > 140
        assert figures["withheld_max_m"] < 0.6
        assert figures["withheld_outside_interval"] == 0

    def test_the_live_states_do_as_well_as_the_settled_ones(self, journey):
        _, log, fixes = journey
        figures = score_withheld(log.live, fixes, log.train.line, OFFLINE_START_NS, PERIOD_NS)
        assert figures["withheld_max_m"] < 0.6
        assert figures["withheld_outside_interval"] == 0

    def test_it_is_one_contiguous_minute_of_rtk_fixes(self, journey):
        scenario, _, fixes = journey
        assert scenario.withheld.to_s - scenario.withheld.from_s == 60.0
        assert {fix.solution for fix in fixes} == {"rtk_fixed"}
        assert max(b.t_s - a.t_s for a, b in pairwise(fixes)) < 1.0

    def test_no_balise_helps_in_it(self, journey):
        scenario, log, _ = journey
        begin, end = (log.truth[at(t)][0] for t in (scenario.withheld.from_s, scenario.withheld.to_s))
        assert end - begin > 100.0
        assert not [b for b in log.train.line.balises if begin - 5.0 <= b.position_m <= end + 5.0]

    def test_the_filters_hear_no_fix_in_it(self, journey):
        scenario, log, _ = journey
        of_gnss = [o.measured_at_ns for o in log.observations if o.unit == "gnss"]
        assert len(of_gnss) > 500
        assert not [ns for ns in of_gnss if at(scenario.withheld.from_s) <= ns < at(scenario.withheld.to_s)]
        states = [s for ns, s in log.settled.items() if at(282.0) <= ns < at(340.0)]
        assert {(e.unit, e.reason) for s in states for e in s.excluded} == {("gnss", "silent")}
        assert {s.status for s in states} == {"degraded"}


class TestReceiverCoasts:
    def test_the_recording_has_such_stretches(self):
        assert len(stretches_without_rtk()) >= 1

    def test_the_state_holds_through_them(self, journey):
        _, log, _ = journey
        for begin, end in stretches_without_rtk():
            inside = {ns: s for ns, s in log.live.items() if at(begin) <= ns <= at(end)}
            assert len(inside) >= (end - begin) * 50 - 1
            assert {s.status for s in inside.values()} <= {"normal", "degraded"}
            for ns, state in inside.items():
                assert state.position_min_m <= log.truth[ns][0] <= state.position_max_m
                assert abs(state.position_m - log.truth[ns][0]) < 0.6

    def test_nowhere_is_the_train_lost_or_outside_its_interval(self, journey):
        _, log, _ = journey
        for states in (log.live, log.settled):
            assert {s.status for s in states.values()} <= {"initialising", "normal", "degraded"}
            assert {b - a for a, b in pairwise(states)} == {PERIOD_NS}
            pairs = [(s, log.truth[ns]) for ns, s in states.items() if ns in log.truth]
            assert len(pairs) > UNTIL_S * 50 - 60
            assert all(s.position_min_m <= truth[0] <= s.position_max_m for s, truth in pairs)

    def test_every_state_has_its_place_on_earth(self, journey):
        _, log, _ = journey
        track = log.train.line.track
        for state in list(log.live.values())[::500]:
            assert track.project(state.latitude_deg, state.longitude_deg).position_m == pytest.approx(
                state.position_m, abs=1e-3
            )


class TestRefused:
    """What would make the withheld figures worthless is refused, in one line, and before the work."""

    def refusal(self, scenario: Path, monkeypatch: pytest.MonkeyPatch) -> str:
        def begun(*_: Any) -> None:
            pytest.fail("the work was begun")

        monkeypatch.setattr("milepost.evaluation.scenario_run.simulate", begun)
        with pytest.raises(ConfigError) as refused:
            run_plan(make_plan(scenario, 1), None, lambda done_s: None)
        return str(refused.value)

    def test_fixes_that_the_filters_would_see_after_all(self, tmp_path, monkeypatch):
        scenario = changed_scenario(tmp_path, change={})
        assert "withheld: units.gnss.withhold_s does not cover it" in self.refusal(scenario, monkeypatch)

    def test_fixes_of_which_the_filters_would_see_a_part(self, tmp_path, monkeypatch):
        scenario = changed_scenario(tmp_path, change={"units": {"gnss": {"withhold_s": [[280.0, 339.9]]}}})
        assert "withheld: units.gnss.withhold_s does not cover it" in self.refusal(scenario, monkeypatch)

    def test_a_unit_without_a_recording(self, tmp_path, monkeypatch):
        scenario = changed_scenario(tmp_path, withheld={"unit": "radar", "from_s": 280.0, "to_s": 340.0})
        assert "withheld.unit: radar has no recording" in self.refusal(scenario, monkeypatch)

    def test_a_span_that_the_run_does_not_reach(self, tmp_path, monkeypatch):
        scenario = changed_scenario(tmp_path, duration_s=300.0)
        assert "withheld.to_s: the run ends before, after 300 s" in self.refusal(scenario, monkeypatch)

    def test_a_span_without_a_fix(self, tmp_path, monkeypatch):
        span = {"unit": "gnss", "from_s": 300.01, "to_s": 300.02}
        assert "withheld: gnss has no fix with the solution rtk_fixed in it" in self.refusal(
            changed_scenario(tmp_path, withheld=span), monkeypatch
        )

    def test_an_estimator_alone_of_a_unit_without_a_filter(self, tmp_path, monkeypatch):
        scenario = changed_scenario(tmp_path, alone=["balise-reader"])
        assert "alone: balise-reader has no filter" in self.refusal(scenario, monkeypatch)


class TestOwnColumns:
    """The log in columns, units and words of another receiver, scenario time 0 half a minute before the withheld minute."""

    LATER_S = 250.0

    def recording(self, folder: Path, **options: Any) -> dict[str, Any]:
        start = datetime(2022, 2, 25, 9, 32, 54, 400_000, tzinfo=UTC)
        rows = ["clock_ms,quality,north,east"]
        for fix in read_gnss_log(gnss_log(LOG)):
            clock = 1000.0 * (start.timestamp() + fix.t_s)
            place = f"{fix.latitude_deg * 1e7:.3f},{fix.longitude_deg * 1e7:.3f}"
            rows.append(f"{clock:.0f},{'fix' if fix.solution == 'rtk_fixed' else 'no'},{place}")
        (folder / "own.csv").write_text("\n".join(rows), encoding="utf-8")
        return {
            "file": str(folder / "own.csv"),
            "time": {"column": "clock_ms", "unit": "ms", "zero_at": 1000.0 * (start.timestamp() + self.LATER_S)},
            "columns": {
                "latitude_deg": {"column": "north", "unit": "1e-7 deg"},
                "longitude_deg": {"column": "east", "unit": "1e-7 deg"},
                "solution": {"column": "quality", "values": {"fix": "rtk_fixed", "*": "propagated"}},
            },
            **options,
        }

    def scenario(self, folder: Path, **options: Any) -> Path:
        recording = self.recording(folder, **options)
        motion = {"gnss_log": {key: value for key, value in recording.items() if key != "average_s"}}
        span = [280.0 - self.LATER_S, 340.0 - self.LATER_S]
        change = {
            "prior": {"position_m": 2700.0, "position_std_m": 500.0, "speed_mps": 10.0},
            "world": {"motion": motion},
            "units": {"gnss": {"recording": recording, "withhold_s": [span]}},
        }
        withheld = {"unit": "gnss", "from_s": span[0], "to_s": span[1]}
        return changed_scenario(
            folder, change=change, withheld=withheld, compare=["fused"], alone=[], duration_s=UNTIL_S - self.LATER_S
        )

    def test_the_withheld_fixes_are_those_that_the_sensor_replays(self, journey, tmp_path):
        _, _, fixes = journey
        scenario, train = load_scenario(self.scenario(tmp_path))
        own = withheld_fixes(SCENARIO, scenario, train)
        assert [fix.t_s for fix in own] == pytest.approx([fix.t_s - self.LATER_S for fix in fixes], abs=2e-3)
        assert [fix.latitude_deg for fix in own] == pytest.approx([fix.latitude_deg for fix in fixes], abs=1e-9)

    def test_a_shift_moves_them_and_a_mean_makes_fewer_of_them(self, journey, tmp_path):
        _, _, fixes = journey
        scenario, train = load_scenario(self.scenario(tmp_path, shift_s=0.1, average_s=2.0))
        own = withheld_fixes(SCENARIO, scenario, train)
        assert len(own) == pytest.approx(len(fixes) / 5, abs=2)
        assert all(scenario.withheld.from_s <= fix.t_s < scenario.withheld.to_s for fix in own)

    def test_the_state_is_as_near_to_them_as_with_the_default_columns(self, tmp_path):
        result = run_plan(make_plan(self.scenario(tmp_path)), None, lambda done_s: None).result
        assert result["withheld_fixes"] > 140
        assert result["withheld_max_m"] < 0.6
        assert result["withheld_outside_interval"] == 0
