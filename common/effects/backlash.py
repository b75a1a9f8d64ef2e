"""Play between stage and instrument."""

from common.effects.base import MotionEffect, Parameter


class Backlash(MotionEffect):
    """The play operator of full width w = width_m: the instrument rests while the stage crosses the gap.

    `y(t + dt) = min(max(y(t), x - w/2), x + w/2)`; without history the stage stands in the middle of the gap.
    """

    name = "backlash"
    parameters = (Parameter("width_m", "m", 0.0, 0.0, 1e2, linear=False),)
    reference = "Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989, the play operator"

    def _configure(self) -> None:
        self._half = 0.5 * self.values["width_m"]

    def reset(self) -> None:
        """Forgets where in the gap the stage stands."""
        self._y: float | None = None

    def transform(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, float, float]:
        """The instrument's motion: the stage's own while it pushes or pulls, rest inside the gap."""
        y = x if self._y is None else self._y
        if x - self._half > y:
            y = x - self._half
        elif x + self._half < y:
            y = x + self._half
        elif self._half > 0.0:
            v = a = 0.0
        self._y = y
        return y, v, a
