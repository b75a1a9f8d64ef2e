"""Haply's service with an Inverse3 and a Verse Grip, as its messages look: JSON in, JSON out. No real one."""

import json
from typing import Any

_VECTOR = ("x", "y", "z")


class HaplyService:
    """Answers as the service does: everything at the start and when asked, a state after each force.

    Attributes:
        asleep: whether the device does not wake up at a force; `present`, `grip`: whether it has them;
            `grip_state`: whether it knows what is pressed.
        position_m, velocity_m_s: of the cursor; `force_n`: as commanded; `given_n`: what the device says it
            gives in its place.
        buttons: of the grip; `grip_status`: what the service says of it.
    """

    def __init__(self) -> None:
        self.asleep, self.present, self.grip, self.silent = False, True, True, False
        self.grip_state = True
        self.more: list[dict[str, Any]] = []
        self.position_m: list[float] = [0.0, 0.0, 0.0]
        self.velocity_m_s: list[float] = [0.0, 0.0, 0.0]
        self.force_n = [0.0, 0.0, 0.0]
        self.given_n: list[float] | None = None
        self.buttons = {"a": False, "b": False, "c": False}
        self.grip_status = {"awake": True, "connected": True, "ready": True}
        self.device_status = {"calibrated": True, "in_use": False, "power_supply": True, "started": True}
        self.commands = 0
        self._awake = False

    def greeting(self) -> str:
        """All that it knows."""
        return self._message(full=True)

    def answer(self, text: str) -> list[str]:
        request = json.loads(text)
        if self.silent:
            return []
        answers = [self.greeting()] if "force_render_full_state" in request.get("session", {}) else []
        for device in request.get("inverse3", []) if self.present else []:
            assert device["device_id"] == "049D", device
            values = device["commands"]["set_cursor_force"]["values"]
            self.force_n = [values[axis] for axis in _VECTOR]
            self.commands += 1
            self._awake = not self.asleep
            answers.append(self._message(full=False))
        return answers

    def _message(self, full: bool) -> str:
        force_n = self.force_n if self.given_n is None else self.given_n
        vectors = {
            "cursor_position": self.position_m,
            "cursor_velocity": self.velocity_m_s,
            "current_cursor_force": force_n,
        }
        state: dict[str, Any] = {
            name: dict(zip(_VECTOR, values, strict=True)) for name, values in vectors.items()
        }
        device: dict[str, Any] = {"device_id": "049D", "state": state | {"control_mode": "cartesian"}}
        grip: dict[str, Any] = {"device_id": "61576"}
        if self.grip_state:
            grip["state"] = {"buttons": self.buttons, "hall": 1}
        if full:
            device |= {
                "config": {"handedness": "right", "port": "COM3"},
                "status": self.device_status | {"ready": self._awake and not self.asleep},
            }
            grip["status"] = self.grip_status
        devices = [device] if self.present else []
        return json.dumps(
            {"inverse3": devices + self.more, "wireless_verse_grip": [grip] if self.grip else []}
        )
