"""From a force of the model to one for the hand: scaled, limited, faded, without a jump, passive. Pure."""

from math import isfinite
from typing import NamedTuple

from forefeel.common.limiter import LimitHit
from forefeel.master.passivity import PassivityLimit, PassivityObserver
from forefeel.master.settings import RenderingSettings

_MAX_STEP_S = 0.010  # s, longest step of time that is rendered: ten periods at 1 kHz
_NO_HITS: tuple[LimitHit, ...] = ()


class Rendered(NamedTuple):
    """The force in N, the limits that changed it, and the energy in J that the hand has put in so far.

    Rules of the hits: `rendered_force`, the limit in N; `rendered_step`, how much the force may change in a
    tick; `rendered_energy`, that it gives the hand no energy.
    """

    force_n: float
    hits: tuple[LimitHit, ...]
    energy_j: float


class ForceRenderer:
    """Makes the force to render from the contact force: scaled, clipped, faded, limited in slew, then made
    passive. The result, `force_n`, never jumps, except where the guard of the passivity limit acts.
    """

    def __init__(self, settings: RenderingSettings) -> None:
        self._settings = settings
        self.late_by(0.0)
        self._fade = 0.0
        self._target_n = 0.0
        self._previous_ns: int | None = None
        self._position_m: float | None = None
        self._applied_n = 0.0
        self.force_n = 0.0

    def late_by(self, actuator_delay_s: float) -> None:
        """Restarts the energy balance, for an actuator of that delay."""
        settings = self._settings
        self._observer = PassivityObserver(actuator_delay_s)
        self._passivity = PassivityLimit(
            settings.max_force_n, settings.max_slew_n_s, settings.max_stiffness_n_m, actuator_delay_s
        )

    def render(self, now_ns: int, contact_n: float | None, live: bool, position_m: float) -> Rendered:
        """Computes the force to render from `contact_n`, with the limits that changed it and the energy so
        far. It fades to zero in fade_s unless `live` and `contact_n` is a finite number. Stateful, once per
        tick; `position_m`: of the handle.
        """
        dt_s = 0.0 if self._previous_ns is None else min((now_ns - self._previous_ns) * 1e-9, _MAX_STEP_S)
        self._previous_ns = now_ns
        moved_m = 0.0 if self._position_m is None else position_m - self._position_m
        self._position_m = position_m
        energy_j = self._observer.observe(moved_m, self._applied_n)
        self._passivity.observe(moved_m, self._applied_n)
        settings, hits = self._settings, _NO_HITS
        usable = live and contact_n is not None and isfinite(contact_n)
        if usable and contact_n is not None:
            asked_n = settings.force_scale * contact_n
            self._target_n = max(-settings.max_force_n, min(settings.max_force_n, asked_n))
            if self._target_n != asked_n:
                hits = (LimitHit("rendered_force", asked_n, self._target_n, "N"),)
        change = dt_s / settings.fade_s
        self._fade = min(1.0, self._fade + change) if usable else max(0.0, self._fade - change)
        wanted_n = self._passivity.damped_n(self._fade * self._target_n, moved_m)
        step_n = settings.max_slew_n_s * dt_s
        slewed_n = max(self.force_n - step_n, min(self.force_n + step_n, wanted_n))
        velocity_m_s = moved_m / dt_s if dt_s > 0.0 else 0.0
        passive_n = self._passivity.limited_n(slewed_n, self.force_n, velocity_m_s, dt_s)
        if passive_n != slewed_n:  # then the step is short because the last force was
            hits += (LimitHit("rendered_energy", wanted_n, passive_n, "N"),)
        elif slewed_n != wanted_n:
            hits += (LimitHit("rendered_step", wanted_n, slewed_n, "N"),)
        self.force_n = self._applied_n = passive_n
        return Rendered(passive_n, hits, energy_j)

    def applied(self, force_n: float) -> None:
        """Replaces the rendered force by the one that the handle applied, in the energy balance alone."""
        self._applied_n = force_n

    def release(self) -> None:
        """Sets the rendered force to zero at once, to fade in again."""
        self._fade = self.force_n = self._applied_n = 0.0
