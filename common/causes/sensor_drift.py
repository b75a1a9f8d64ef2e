"""Slow ramp of the load cell."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.bias import Bias
from forefeel.common.causes.candidate import (
    Entry,
    Extent,
    Found,
    ReadingColumns,
    Shape,
    Values,
    entry,
    log_grid,
)
from forefeel.common.causes.offline import Array


def _ramp(t: Array, _shape: Shape) -> Array:
    return t[:, None]


def _creep(t: Array, shape: Shape) -> Array:
    return (1.0 - np.exp(-t / shape[0]))[:, None]


def _times(extent: Extent) -> list[Shape]:
    return log_grid(0.1 * extent.duration_s, 0.7 * extent.duration_s, 5)


def _settling(found: Found) -> Values:
    return {"rate_n_s": found.coefficients[0] / found.shape[0], "settling_s": found.shape[0]}


def _from_start(found: Found) -> list[Entry]:
    """The ramp, and the bias that it has at the stamp 0."""
    rate = found.coefficients[0] / (found.shape[0] if found.shape else 1.0)
    shift = [entry(Bias, {"force_n": -rate * found.start_s})] if found.start_s else []
    return [entry(SensorDrift, {"rate_n_s": rate}), *shift]


class SensorDrift(ForceEffect):
    """`f = rate_n_s t`, also at no load; t counts from the caller's own zero."""

    name = "sensor_drift"
    site = "sensor"
    parameters = (Parameter("rate_n_s", "N/s", 0.0, -1e3, 1e3),)
    reference = "linear zero drift of the measurement"
    fingerprint = "a straight ramp in time that goes on at rest and at no load"
    words = "a drift of the load cell"
    equation = ("{rate_n_s} t",)
    candidates = (
        ReadingColumns(coefficients=("rate_n_s",), signs=(0,), columns=_ramp, making=_from_start),
        ReadingColumns(
            form="creep",
            signs=(0,),
            columns=_creep,
            grid=_times,
            naming=_settling,
            sizes=("rate_n_s",),
            making=_from_start,
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(t,)."""
        return (t,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return t[:, None].copy()
