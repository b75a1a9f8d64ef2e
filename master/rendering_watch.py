"""Independent watch of what the hand feels, beside predictor and renderer. Pure."""

from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.messages import ForceSample
from forefeel.common.settings import AxisLimits
from forefeel.common.slots import CommandRing
from forefeel.master.rendering import Rendered
from forefeel.master.settings import RenderingSettings

_DISTRUST_S, _END_S = 0.2, 0.3
"""In s: healthy runs have .012 s at most, and a release takes half a round trip to the stage."""
_WALLS = 3.0  # a wall may be stiffer than the settings say: 8000 N/m at their default of 3000
_BEYOND = 2.0  # limits: a force changes from one end of the limit to the other, and is back at zero
_ALWAYS = 0.33  # of the limit: friction that turns, pulsation, a wall's own motion within a round trip
_FELT, _NOTHING = 0.1, 0.02  # of the limit: a force that must be felt, and one that is not
_LONGEST_STEP_S = 0.010  # as the renderer counts time


class RenderingWatch:
    """Sums up the time in which the felt force is wrong; right ticks take off a quarter, so that flickering
    is noticed. Wrong is a prediction that is no number, or further from the newest measured force than its
    band and the motion since allow; and one of a tenth of the limit of which nothing is rendered, though the
    passivity limit did not act.

    Attributes:
        distrusts: the late force is to take the place of the prediction, until the deadman is let go.
        ends: the following is to end, too, for it went on.
    """

    def __init__(self, settings: RenderingSettings, limits: AxisLimits) -> None:
        self._feels_zoh = settings.source == "zoh"
        self._limit_n, self._stiffness_n_m = limits.max_force_n, _WALLS * limits.wall_n_m
        self._nothing_n = _NOTHING * min(settings.force_scale * limits.max_force_n, settings.max_force_n)
        self._path_m = CommandRing[float]()
        self._position_m = self._moved_m = self._wrong_s = 0.0
        self._previous_ns = 0
        self.distrusts = self.ends = False

    def judge(
        self,
        now_ns: int,
        position_m: float,
        deadman: bool,
        newest: ForceSample | None,
        predicted: Estimate | None,
        rendered: Rendered,
    ) -> None:
        """Updates `distrusts` and `ends` by one tick: set once wrong ticks sum up to 0.2 s and 0.3 s, right
        ones taking off a quarter; both cleared while the deadman is released. `newest`: measured force that
        is to be felt; without it or a prediction nothing is wrong. `rendered`: in the tick before.
        """
        self._moved_m += abs(position_m - self._position_m)
        self._position_m = position_m
        self._path_m.put(now_ns, self._moved_m)
        dt_s, self._previous_ns = min((now_ns - self._previous_ns) * 1e-9, _LONGEST_STEP_S), now_ns
        wrong = newest is not None and predicted is not None and self._wrong(newest, predicted, rendered)
        self._wrong_s = max(0.0, self._wrong_s + (dt_s if wrong else -0.25 * dt_s)) if deadman else 0.0
        self.distrusts = deadman and (self.distrusts or self._wrong_s > _DISTRUST_S)
        self.ends = deadman and (self.ends or self._wrong_s > _END_S)

    def _wrong(self, newest: ForceSample, predicted: Estimate, rendered: Rendered) -> bool:
        """True if the prediction is no number, or is further from the measured force than a share of the
        force, half of its band and the motion since allow; or if both forces are clear and none is rendered
        though the passivity limit did not act. Where the zero-order hold is rendered, the measured force
        counts as the prediction.
        """
        measured_n = newest.force_n
        predicted_n = measured_n if self._feels_zoh else predicted.force_n
        most_n = max(self._limit_n, abs(measured_n))
        off_n, allowed_n = abs(predicted_n - measured_n), _ALWAYS * most_n
        if not off_n <= allowed_n:  # written so that what is no number is outside
            moved_m = self._moved_m - (self._path_m.get(newest.answers_stamp_ns or 0) or 0.0)
            half_n = 0.5 * (predicted.high_n - predicted.low_n)
            allowed_n += min(_BEYOND * most_n, half_n + self._stiffness_n_m * moved_m)
        least_n = min(abs(measured_n), abs(predicted_n))
        dark = least_n > _FELT * self._limit_n and abs(rendered.force_n) < self._nothing_n
        passive = dark and any(hit.rule == "rendered_energy" for hit in rendered.hits)
        return not off_n <= allowed_n or (dark and not passive)
