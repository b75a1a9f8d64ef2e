"""Handles with a thread of their own: the port, but for what a state says and what a force becomes."""

from collections import Counter
from typing import Generic, Protocol, TypeVar

from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.shared.conversation import Conversation, Steps


class Deadman:
    """Detects that the deadman was let go and pressed again, with which a person re-arms a handle.
    `pressed_anew`: it was, since this object was made, and is pressed now.
    """

    def __init__(self) -> None:
        self.pressed_anew = self._let_go = False

    def take(self, pressed: bool | None) -> None:
        """Takes the newest state of the deadman; None, where the handle can not tell, is no letting go."""
        if pressed is None:
            self.pressed_anew = False
            return
        self.pressed_anew = pressed and (self.pressed_anew or self._let_go)
        self._let_go = not pressed


class Exchange(Protocol):
    """The thread's half of a handle. `deadman`: since the handshake."""

    deadman: Deadman

    def clear_setpoint(self) -> None: ...


E = TypeVar("E", bound=Exchange)


class ThreadedHandle(Generic[E]):
    """Handle port; the subclasses read, render and define the conversation, whose thread owns the device.

    Any fault takes the force away and the readings with it, until the handshake has been done again and
    `rearm` is called.

    Attributes:
        link: its state, what the device is, and what was counted.
    """

    finished = False
    clutched_out_s = 0.0
    """A hand does not say whether it means to wait."""

    def __init__(self, link: DeviceLink, talk: E, open_s: float) -> None:
        """`open_s`: time in s that opening may take."""
        self.link, self._talk, self._open_s = link, talk, open_s
        self._conversation: Conversation | None = None

    @property
    def counters(self) -> Counter[str]:
        return self.link.counters

    @property
    def pressed_anew(self) -> bool:
        return self.link.state is LinkState.CONFIGURED and self._talk.deadman.pressed_anew

    def open(self) -> None:
        """Connects and shakes hands.

        Raises:
            DeviceSetupError: nobody answers, or not the device that the settings name.
            DeviceError: it does not get ready.
        """
        self.close()
        self._conversation = Conversation(self.link, self._converse)
        self._conversation.start(self._open_s)

    def close(self) -> None:
        self._talk.clear_setpoint()
        conversation, self._conversation = self._conversation, None
        if conversation is not None:
            conversation.stop()

    def rearm(self) -> None:
        """Re-arms the link, the explicit act after a fault; no force before the next `render`. DeviceError:
        the handshake has not been done again.
        """
        self._talk.clear_setpoint()
        self.link.rearm()

    def _converse(self, conversation: Conversation) -> Steps:
        raise NotImplementedError
