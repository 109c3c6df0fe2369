"""Cost of one predict and update, ours and the peers', and of the nodes' whole steps."""

from __future__ import annotations

import timeit
from collections.abc import Callable
from pathlib import Path

import numpy as np

from milepost.config.roles import ROLES, Setting
from milepost.config.train import load_train
from milepost.estimation.estimator import Prior
from milepost.estimation.filters import FILTERS
from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.kalman import ArrayKernel
from milepost.estimation.layout import Layout
from milepost.estimation.motion import process_noise, transition
from milepost.estimation.observation import Observation
from milepost.estimation.scalar import ScalarKernel
from milepost.offline.run import simulate
from milepost_schemas import decode, encode

DT, Q, R = 0.01, 1e-6, 0.04
ROW = (0.0, 1.0, 0.0)
TRAIN = Path("deploy/trains/maglev.yaml")
OFFLINE = {name: Path(f"deploy/trains/{name}.yaml") for name in ("full", "maglev")}


def microseconds(call: Callable[[], object], number: int, rounds: int = 5) -> float:
    """The median over rounds of a call's mean duration."""
    return float(np.median([timeit.timeit(call, number=number) / number for _ in range(rounds)])) * 1e6


def ours(kernel: ScalarKernel | ArrayKernel) -> Callable[[], object]:
    state = kernel.pack(np.array([0.0, 20.0, 0.0]), np.eye(3))

    def step() -> None:
        nonlocal state
        state = kernel.update(kernel.advance(state, DT), ROW, 20.0, R)

    return step


def filterpy_step() -> Callable[[], object]:
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(dim_x=3, dim_z=1)
    kf.x, kf.P = np.array([[0.0], [20.0], [0.0]]), np.eye(3)
    kf.F, kf.Q = transition(DT), process_noise(DT, Q)
    kf.H, kf.R = np.array([ROW]), np.array([[R]])
    z = np.array([[20.0]])

    def step() -> None:
        kf.predict()
        kf.update(z)

    return step


def stonesoup_step() -> Callable[[], object]:
    from datetime import datetime, timedelta

    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import ConstantAcceleration
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    predictor = KalmanPredictor(ConstantAcceleration(Q))
    updater = KalmanUpdater(LinearGaussian(3, [1], np.array([[R]])))
    time = datetime(2025, 1, 1)
    state = GaussianState([[0.0], [20.0], [0.0]], np.eye(3), timestamp=time)

    def step() -> None:
        nonlocal state, time
        time += timedelta(seconds=DT)
        prediction = predictor.predict(state, timestamp=time)
        state = updater.update(SingleHypothesis(prediction, Detection([[20.0]], timestamp=time)))

    return step


def whole_step(kind: str) -> Callable[[], object]:
    """A reading into a local filter, and its belief out: what a filter node asks for each reading."""
    row = FILTERS[kind]
    prior = Prior(np.array([0.0, 20.0, 0.0]), np.array([1.0, 1.0, 1.0]))
    local = row(FilterSetup(Layout(), 1e-2, prior, 5_000_000_000), row.options_model())
    rng = np.random.default_rng(1)
    at, sequence, noise = 1_000_000_000_000, 0, rng.normal(size=10_000).tolist()

    def step() -> None:
        nonlocal at, sequence
        at, sequence = at + 200_000_000, sequence + 1
        local.estimator.advance_to(at)
        value = 4.0 * sequence + noise[sequence % len(noise)]
        local.take([Observation(at, 0, sequence, "bench", 0, "gnss", (1.0, 0.0, 0.0), value, 1.0)], at)
        local.estimator.lists_at(at)

    return step


def measure_steps() -> dict[str, float]:
    """µs for one predict and update, and for a reading's whole way through each kind of local filter."""
    return {
        **{f"local filter {kind}": microseconds(whole_step(kind), 500) for kind in FILTERS},
        "filter step (scalar kernel)": microseconds(ours(ScalarKernel(Q)), 20_000),
        "filter step (array kernel)": microseconds(ours(ArrayKernel(Layout(), Q)), 2_000),
        "filterpy step": microseconds(filterpy_step(), 2_000),
        "Stone-Soup step": microseconds(stonesoup_step(), 200),
    }


def measure_nodes() -> dict[str, float]:
    """µs of whole steps on real messages: reading to estimate, estimate to states, encode, decode."""
    train = load_train(TRAIN)
    heard: dict[str, list] = {}
    simulate(train, 12.0, lambda output, now: heard.setdefault(output.stream, []).append((output.message, now)))
    out: dict[str, float] = {}

    def per_message(build: Callable[[], object], messages: list) -> float:
        rounds = []
        for _ in range(3):
            node = build()
            begun = timeit.default_timer()
            for message, now in messages:
                for _ in node.step(message, now):
                    pass
            rounds.append((timeit.default_timer() - begun) / len(messages))
        return float(np.median(rounds)) * 1e6

    setting = Setting("bench")
    radar = [entry for entry in heard["speed_reading"] if entry[0].unit == "radar"]
    both = sorted([*radar, *heard["feedback"]], key=lambda entry: entry[1])
    out["filter node: reading or feedback in, estimate out"] = per_message(
        lambda: ROLES["filter"].build(train, "radar", setting), both
    )
    estimates = sorted([*heard["estimate"], *heard["fix"]], key=lambda entry: entry[1])
    out["fuser node: estimate in, state and feedback out"] = per_message(
        lambda: ROLES["fuser"].build(train, "fuser", setting), estimates
    )
    for stream in ("speed_reading", "estimate", "state"):
        message = heard[stream][-1][0]
        payload = encode(message)
        out[f"encode {stream} ({len(payload)} bytes)"] = microseconds(lambda m=message: encode(m), 5_000)
        out[f"decode {stream}"] = microseconds(lambda p=payload, m=message: decode(p, type(m)), 5_000)
    return out


def measure_offline(train_file: Path) -> float:
    """Offline speed of a train, × real time: median of three runs of 30 s."""
    train = load_train(train_file)
    speeds = []
    for _ in range(3):
        begun = timeit.default_timer()
        simulate(train, 30.0)
        speeds.append(30.0 / (timeit.default_timer() - begun))
    return float(np.median(speeds))
