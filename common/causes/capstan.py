"""Friction along a bent shaft: it multiplies the tip's force."""

from itertools import product

from forefeel.common.causes.base import FactorEffect, Parameter
from forefeel.common.causes.candidate import (
    Entry,
    Extent,
    Fitted,
    Grid,
    Modulation,
    Shape,
    Values,
    entry,
    log_grid,
)
from forefeel.common.causes.motion import Kinematics, Value
from forefeel.common.causes.sensor import Bias

_LEAST, _MOST = 0.03, 1.5  # rad, wraps that are tried; chosen
_ZEROS = 0.0, 0.2, 0.4, 0.6, 0.8, 1.0  # of the force's range, where the tip's may be zero; chosen


def _wraps_and_zeros(extent: Extent) -> list[Shape]:
    zeros_n = [extent.low_n + share * (extent.high_n - extent.low_n) for share in _ZEROS]
    wraps = [wrap_rad for (wrap_rad,) in log_grid(4.0 * _LEAST, _MOST, 3)]
    return list(product(wraps, zeros_n))


def _wraps_of_depths(extent: Extent) -> list[Shape]:
    reach_m = max(extent.high_m, 0.5 * extent.stroke_m)
    return [(wrap_rad / reach_m, zero_n) for wrap_rad, zero_n in _wraps_and_zeros(extent)]


def _form_with_zero(form: str, wrap: str, grid: Grid) -> Modulation:
    """Returns a form of the capstan that searches the parameter `wrap` and `zero_n`, the reading in N at
    which the tip bears nothing: the sign of the tip's force is that of the reading less `zero_n`.

    Its coefficient is a preload: a model.yaml gets an entry of the capstan and a `bias` at the site `wall`.
    """

    def named(fitted: Fitted) -> Values:
        return {wrap: fitted.shape[0]}

    def entries(fitted: Fitted) -> list[Entry]:
        preload = entry(Bias, {"force_n": float(fitted.coefficients[0])})
        return [entry(Capstan, named(fitted)), {**preload, "site": "wall"}]

    return Modulation(
        form=form, coefficients=("preload_n",), shapes=(wrap, "zero_n"), naming=named, making=entries,
        signs=(0,), sizes=(wrap,), grid=grid, by_tip=True, logarithmic=False, mass_site="sensor", costly=True,
    )  # fmt: skip


class Capstan(FactorEffect):
    """`F = F_tip exp(wrap s)`: against its motion the stage feels more than the tip, along with it less.

    wrap = wrap_rad + wrap_rad_m max(x, 0) is the coefficient of friction times the angle by which the shaft
    is wrapped, which grows with the inserted length where the bends do; s is the direction of the motion, see
    `direction`, by the sign of F_tip. All that acts on shaft and wall is multiplied. A spring that is not
    relaxed at 0 has a preload, in a model.yaml a `bias` at the site `wall`.
    """

    name = "capstan"
    parameters = (
        Parameter("wrap_rad", "rad", 0.0, 0.0, 10.0, linear=False),
        Parameter("wrap_rad_m", "rad/m", 0.0, 0.0, 1e5, linear=False),
    )
    picture = "direction"
    kin = "friction of the length"
    rubs = True
    reference = "capstan (Euler-Eytelwein) equation"
    fingerprint = (
        "a jump at each reversal that is everywhere the same share of the force: it opens with depth"
    )
    words = "friction along the bent shaft that multiplies the tip's force"
    equation = (
        "the tip's force times exp({wrap_rad_m} max(x, 0) sgn(x')), by its sign",
        "the tip's force times exp({wrap_rad} sgn(x')), by its sign",
    )
    candidates = (
        Modulation(
            shapes=("wrap_rad",), sizes=("wrap_rad",), picture="direction",
            grid=lambda extent: log_grid(_LEAST, _MOST, 9),
        ),
        _form_with_zero("tip", "wrap_rad", _wraps_and_zeros),
        _form_with_zero("depth", "wrap_rad_m", _wraps_of_depths),
    )  # fmt: skip

    def factor(self, m: Kinematics, force_n: Value) -> Value:
        """exp(wrap s), s with the sign of force_n."""
        wrap = self.values["wrap_rad"] + self.values["wrap_rad_m"] * m.depth
        return m.exp(wrap * m.direction() * m.sign(force_n))
