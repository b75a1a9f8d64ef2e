"""A command as the master sends it, and what the slave does with it before it may be executed."""

import threading
import time
from collections.abc import Callable

from forefeel.common.codec import decode, encode
from forefeel.common.messages import MotionCommand
from forefeel.common.transport.port import Put
from forefeel.slave.gate import CommandGate, GateLimits

_SESSION_ID = 7  # id of the session, arbitrary, the same at both ends
_LIMITS = GateLimits(max_age_ns=1_000_000_000, position_m=(-0.1, 0.2), velocity_m_s=2.0)


def command(number: int) -> bytes:
    """A motion command, encoded, of the session that the gate admits."""
    message = MotionCommand(
        session_id=_SESSION_ID, sequence=number, stamp_ns=time.monotonic_ns(), position_m=0.05,
        velocity_m_s=0.01, deadman=True, recording_time_s=None,
    )  # fmt: skip
    return encode(message)


def gated(put: Put, answer: bytes | None = None) -> Callable[[bytes, int], None]:
    """Decodes, validates and gates a payload that came at a stamp; then puts `answer`, else the payload."""
    gate = CommandGate(_LIMITS)
    gate.open(_SESSION_ID)
    lock = threading.Lock()

    def admit(payload: bytes, receive_ns: int) -> None:
        with lock:
            refusal = gate.admit(decode(MotionCommand, payload), receive_ns, None)
        if refusal is not None:
            raise SystemExit(f"refused: {refusal}")
        put(payload if answer is None else answer)

    return admit
