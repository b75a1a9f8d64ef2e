"""What the slave does with a command before it may be executed."""

import threading
from collections.abc import Callable

from common.codec import decode
from common.messages import MotionCommand
from common.transport.port import Put
from slave.gate import CommandGate, GateLimits

SESSION = 7
"""The session that the gate admits."""
_LIMITS = GateLimits(max_age_ns=1_000_000_000, position_m=(-0.1, 0.2), velocity_m_s=2.0)


def gated(put: Put, answer: bytes | None = None) -> Callable[[bytes, int], None]:
    """Decodes, validates and gates a payload that came at a stamp; then puts `answer`, else the payload."""
    gate = CommandGate(_LIMITS)
    gate.open(SESSION)
    lock = threading.Lock()

    def admit(payload: bytes, receive_ns: int) -> None:
        with lock:
            refusal = gate.admit(decode(MotionCommand, payload), receive_ns, None)
        if refusal is not None:
            raise SystemExit(f"refused: {refusal}")
        put(payload if answer is None else answer)

    return admit
