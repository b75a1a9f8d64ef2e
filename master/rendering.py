"""From a force of the model to one for the hand: scaled, limited, faded, passive, without a jump. Pure."""

from math import isfinite
from typing import NamedTuple

from forefeel.common.limiter import LimitHit
from forefeel.master.passivity import PassivityController, PassivityObserver
from forefeel.master.settings import RenderingSettings

_MAX_STEP_S = 0.010  # s, longest step of time that is rendered: ten periods at 1 kHz
_NO_HITS: tuple[LimitHit, ...] = ()


class Rendered(NamedTuple):
    """The force in N, the limits that changed it, and the energy in J that the hand has put in so far.

    Rules: `rendered_force`, its limit in N; `rendered_step`, how much it may change in a tick.
    """

    force_n: float
    hits: tuple[LimitHit, ...]
    energy_j: float


class ForceRenderer:
    """Never shows a force that is stale, not finite, above the limit, or that jumps.

    A change of the force is bounded in three ways: by `max_slew_n_s` altogether, by `max_stiffness_n_m` for
    each metre that the hand moves, and by `max_jump_n_s` for what changes without a motion: a model that has
    learned something must not kick the hand.

    Attributes:
        force_n: what is rendered now.
    """

    def __init__(self, settings: RenderingSettings) -> None:
        self._settings = settings
        self._fade = 0.0
        self._target_n = 0.0
        self._previous_ns: int | None = None
        self._position_m: float | None = None
        self._observer = PassivityObserver()
        self._controller = PassivityController(settings.max_damping_n_s_m)
        self.force_n = 0.0

    def render(self, now_ns: int, contact_n: float | None, live: bool, position_m: float) -> Rendered:
        """The force for a hand that is at `position_m` now.

        `live`: armed, and the feedback is fresh; else the force fades to zero in fade_s.
        """
        dt_s = self._step_s(now_ns)
        moved_m = 0.0 if self._position_m is None else position_m - self._position_m
        self._position_m = position_m
        energy_j = self._observer.observe(position_m, self.force_n)
        settings, hits = self._settings, _NO_HITS
        usable = live and contact_n is not None and isfinite(contact_n)
        if usable and contact_n is not None:
            asked_n = settings.force_scale * contact_n
            self._target_n = max(-settings.max_force_n, min(settings.max_force_n, asked_n))
            if self._target_n != asked_n:
                hits = (LimitHit("rendered_force", asked_n, self._target_n, "N"),)
        change = dt_s / settings.fade_s
        self._fade = min(1.0, self._fade + change) if usable else max(0.0, self._fade - change)
        wanted_n = self._fade * self._passive_n(energy_j, moved_m, dt_s)
        step_n = self._step_n(abs(moved_m), dt_s) if usable else settings.max_slew_n_s * dt_s
        self.force_n = max(self.force_n - step_n, min(self.force_n + step_n, wanted_n))
        if self.force_n != wanted_n:
            hits += (LimitHit("rendered_step", wanted_n, self.force_n, "N"),)
        return Rendered(self.force_n, hits, energy_j)

    def release(self) -> None:
        """Nothing was applied: fades in from zero."""
        self._fade = self.force_n = 0.0

    def _passive_n(self, energy_j: float, moved_m: float, dt_s: float) -> float:
        """The target with the controller's damping where that is on, within the limit."""
        if not (self._settings.passivity_controller and dt_s > 0.0):
            return self._target_n
        target_n = self._target_n + self._controller.force_n(energy_j, moved_m / dt_s, dt_s)
        return max(-self._settings.max_force_n, min(self._settings.max_force_n, target_n))

    def _step_n(self, moved_m: float, dt_s: float) -> float:
        """How much the force may change in this step."""
        settings = self._settings
        slowest_n = settings.max_stiffness_n_m * moved_m + settings.max_jump_n_s * dt_s
        return min(settings.max_slew_n_s * dt_s, slowest_n)

    def _step_s(self, now_ns: int) -> float:
        previous_ns, self._previous_ns = self._previous_ns, now_ns
        return 0.0 if previous_ns is None else min((now_ns - previous_ns) * 1e-9, _MAX_STEP_S)
