"""Faults written into a real receiver's log: what no train can do does not count, and the truth stays inside the interval."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from harness import PERIOD_NS, ROOT, at

from examples import gnss_log
from milepost.config.scenario_file import load_scenario
from milepost.evaluation.run_log import RunLog
from milepost.offline.run import simulate
from milepost.recordings.gnss_log import read_gnss_log

SCENARIO = ROOT / "deploy/scenarios/brussels-28876.yaml"
LOG = ROOT.parent / "shared/data/brussels/log_28876_gnss.csv"
# sound RTK at 19 to 22 m/s before the fault and after it
FROM_S, UNTIL_S = 16.0, 49.0
# a degree of latitude, and of longitude at 50.9 degrees, m
DEGREE_M = (111250.0, 70310.0)

pytestmark = [
    pytest.mark.skipif(not LOG.is_file(), reason="../shared/data/brussels, the recorded train logs, is not here"),
    pytest.mark.long,
]

Place = tuple[float, float]
Fault = Callable[[list[Place], int], Place]


def frozen(places: list[Place], k: int) -> Place:
    """The last sound position, again and again."""
    return places[round(FROM_S / 0.4)]


def slowed(places: list[Place], k: int) -> Place:
    """At half the speed since the onset: smooth, near the track, 10 m/s less from one fix to the next."""
    onset = round(FROM_S / 0.4)
    a, b = places[onset + (k - onset) // 2], places[onset + (k - onset + 1) // 2]
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])


def beside(places: list[Place], k: int) -> Place:
    """8 m north of the track, which runs east."""
    return places[k][0] + 8.0 / DEGREE_M[0], places[k][1]


def journey(folder: Path, fault: Fault, fault_s: float) -> RunLog:
    """The train whose receiver's log has a fault for so long."""
    with LOG.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    places = [(float(row["latitude_deg"]), float(row["longitude_deg"])) for row in rows]
    for k in range(round(FROM_S / 0.4) + 1, round((FROM_S + fault_s) / 0.4) + 1):
        latitude, longitude = fault(places, k)
        rows[k] |= {"latitude_deg": f"{latitude:.9f}", "longitude_deg": f"{longitude:.9f}"}
    with (folder / "log.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    content = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    content |= {
        "train": str(SCENARIO.parent / content["train"]),
        "change": {"units": {"gnss": {"recording": str(folder / "log.csv")}}},
    }
    (folder / "scenario.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    _, train = load_scenario(folder / "scenario.yaml")
    log = RunLog(train)
    simulate(train, UNTIL_S, log.tap, log.keep)
    return log


@pytest.mark.parametrize(
    ("fault", "lasts_s", "let_in"),
    [
        (frozen, 24.0, 0),
        # for less than a proof takes; longer ones are for the other sensors to find
        (slowed, 5.6, 0),
        # two fixes are no mean yet
        (beside, 7.6, 2),
    ],
)
def test_a_faulty_receiver_is_not_believed(tmp_path: Path, fault: Fault, lasts_s: float, let_in: int) -> None:
    log = journey(tmp_path, fault, lasts_s)
    sound = {at(fix.t_s) for fix in read_gnss_log(gnss_log(LOG)) if fix.solution == "rtk_fixed" and fix.t_s < UNTIL_S - 0.1}
    onset, end, proved = at(FROM_S), at(FROM_S + lasts_s), at(FROM_S + lasts_s + 6.5)
    counted = log.counted["gnss"]
    assert len([ns for ns in counted if onset < ns <= end]) <= let_in
    # before the fault every fix counts, and after it again once the receiver has proved itself
    assert {ns for ns in sound if ns <= onset} <= counted
    assert {ns for ns in sound if ns > proved} <= counted
    assert max(sound) > proved
    for states in (log.live, log.settled):
        pairs = [(state, log.truth[ns]) for ns, state in states.items() if ns in log.truth]
        assert len(pairs) > UNTIL_S * 1e9 / PERIOD_NS - 60
        assert all(state.position_min_m <= truth[0] <= state.position_max_m for state, truth in pairs)
