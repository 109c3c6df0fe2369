"""The centralised filter: one pass over all readings in order of time. Every other result is compared with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from milepost.estimation.time_units import S_PER_NS

from .estimator import Prior
from .gaussian import stretched
from .kalman import predict, update
from .layout import PLACES_OF_COMMON, Array, Layout
from .motion import Steps

LinearRow = tuple[tuple[float, ...], float, float]


class Reading(NamedTuple):
    """One reading at its place in time, (`measured_at_ns`, `order`, `sequence`, `instance`).

    `observe` turns it into rows (h, z, R) over [s, v, a, own private], given the mean (n) and covariance (n, n) of these.
    """

    measured_at_ns: int
    order: int
    sequence: int
    instance: str
    unit: str
    observe: Callable[[Array, Array], Iterable[LinearRow]]


def centralised(
    readings: Iterable[Reading],
    epochs_ns: Iterable[int],
    layout: Layout,
    jerk_psd: float,
    prior: Prior,
    begins_ns: int | None = None,
) -> Iterator[tuple[int, Array, Array]]:
    """The optimal estimate at each epoch, from all readings until then: (epoch, mean (n), covariance (n, n)).

    An extended Kalman filter over the full state: each reading is linearised at what all readings before it say. For linear
    sensors it is the Kalman filter. The prior sits at the earliest reading, or at `begins_ns`, before which no reading
    counts. Epochs before it are left out.
    """
    ordered = sorted(readings, key=lambda reading: (reading.measured_at_ns, reading.order, reading.sequence))
    if not ordered:
        return
    steps = Steps(layout, jerk_psd)
    x, P = layout.prior(prior.mean, prior.std)
    at, place = ordered[0].measured_at_ns if begins_ns is None else begins_ns, 0
    for epoch in sorted(epochs_ns):
        if epoch < at:
            continue
        while place < len(ordered) and ordered[place].measured_at_ns <= epoch:
            reading = ordered[place]
            x, P = _carried(steps, x, P, reading.measured_at_ns - at)
            x, P = _take(x, P, reading, layout)
            at = max(at, reading.measured_at_ns)
            place += 1
        yield epoch, *_carried(steps, x, P, epoch - at)


def _carried(steps: Steps, x: Array, P: Array, dt_ns: int) -> tuple[Array, Array]:
    return predict(x, P, *steps.over(dt_ns * S_PER_NS)) if dt_ns > 0 else (x, P)


def _take(x: Array, P: Array, reading: Reading, layout: Layout) -> tuple[Array, Array]:
    own = layout.indices.get(reading.unit, PLACES_OF_COMMON)
    rows = reading.observe(x, P) if len(own) == layout.dimension else reading.observe(x[list(own)], P[np.ix_(own, own)])
    scale = layout.scales.get(reading.unit)
    for row, value, variance in rows:
        before = x
        x, P = update(x, P, np.array(layout.lift(reading.unit, row)), value, variance)
        if scale is not None:
            P = stretched(before, x, P, scale)
    return x, P
