"""From a force of the model to a force for the hand: scaled, limited, slew-limited, faded. Pure."""

from math import isfinite

from master.settings import RenderingSettings

_MAX_STEP_S = 0.010


class ForceRenderer:
    """Never shows a force that is stale, not finite, above the limit, or that jumps.

    Attributes:
        force_n: what is rendered now.
    """

    def __init__(self, settings: RenderingSettings) -> None:
        self._settings = settings
        self._fade = 0.0
        self._target_n = 0.0
        self._previous_ns: int | None = None
        self.force_n = 0.0

    def render(self, now_ns: int, contact_n: float | None, live: bool) -> tuple[float, bool]:
        """(force in N, whether a limit acted). `live`: armed, and the feedback is fresh; else the force fades
        to zero in fade_s.
        """
        dt_s = self._step_s(now_ns)
        settings, limited = self._settings, False
        usable = live and contact_n is not None and isfinite(contact_n)
        if usable and contact_n is not None:
            asked_n = settings.force_scale * contact_n
            self._target_n = max(-settings.max_force_n, min(settings.max_force_n, asked_n))
            limited = self._target_n != asked_n
        change = dt_s / settings.fade_s
        self._fade = min(1.0, self._fade + change) if usable else max(0.0, self._fade - change)
        wanted_n = self._fade * self._target_n
        step_n = settings.max_slew_n_s * dt_s
        applied_n = max(self.force_n - step_n, min(self.force_n + step_n, wanted_n))
        self.force_n = applied_n
        return applied_n, limited or applied_n != wanted_n

    def _step_s(self, now_ns: int) -> float:
        previous_ns, self._previous_ns = self._previous_ns, now_ns
        return 0.0 if previous_ns is None else min((now_ns - previous_ns) * 1e-9, _MAX_STEP_S)
