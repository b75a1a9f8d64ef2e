"""The force now, from the operator's own motion and the model that the slave's late samples identified."""

from math import inf, isfinite
from operator import mul

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.identification import ContactEstimate
from forefeel.common.estimation.state_filter import GAP_S, StateFilter


class ContactPredictor:
    """One contact model on the master's own motion: f = phi' theta.

    The position enters as it is, so the elastic force has no lag. Velocity and acceleration are the given
    velocity and its derivative through a `StateFilter`, whose lag is 2 / (2 pi cutoff_hz): 8 ms at 40 Hz,
    below the 15 ms at which a delayed damper is felt. The acceleration is never a raw difference, so the
    inertia term renders no encoder steps.

    The regressors' states (friction, relaxation) follow the motion at every call, with or without an
    estimate. A pause over 0.1 s starts them anew. A stamp that does not increase, or a number that is not
    finite, leaves them as they are.

    Args:
        model: the model whose parameters the estimates hold.
        cutoff_hz: of the velocity's filter.
    """

    def __init__(self, model: ContactModel, cutoff_hz: float) -> None:
        self._runtime = model.runtime()
        self._velocity = StateFilter(cutoff_hz)
        self._origin_ns = 0
        self.reset()

    def reset(self) -> None:
        self._runtime.reset()
        self._velocity.reset()
        self._last_ns: int | None = None
        self._phi: list[float] | None = None

    def predict(
        self, stamp_ns: int, position_m: float, velocity_m_s: float, estimate: ContactEstimate | None
    ) -> float | None:
        """The force in N, or None: no valid estimate, no motion yet (first call, after a pause), or input not
        finite.

        Raises:
            ValueError: the estimate is one of another model.
        """
        if not (isfinite(position_m) and isfinite(velocity_m_s)):
            return None
        if estimate is not None:
            self._origin_ns = estimate.origin_ns
        self._move(stamp_ns, position_m, velocity_m_s)
        if estimate is None or not estimate.valid or self._phi is None:
            return None
        if estimate.names != self._runtime.linear_names:
            raise ValueError(f"estimate of {estimate.names}: expected {self._runtime.linear_names}")
        force_n: float = sum(map(mul, self._phi, estimate.values))
        return force_n

    def _move(self, stamp_ns: int, position_m: float, velocity_m_s: float) -> None:
        """Advances the filter and the regressors to the stamp."""
        dt = inf if self._last_ns is None else (stamp_ns - self._last_ns) * 1e-9
        if dt <= 0.0:
            return
        if dt > GAP_S:
            self.reset()
            self._velocity.step(velocity_m_s, 0.0)
        else:
            v, a, _ = self._velocity.step(velocity_m_s, dt)
            self._phi = self._runtime.regressors((stamp_ns - self._origin_ns) * 1e-9, position_m, v, a, dt)
        self._last_ns = stamp_ns
