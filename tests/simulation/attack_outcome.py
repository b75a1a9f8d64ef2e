"""Outcome of an attack, and the one that is expected."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Expected:
    """Required outcome of an attack.

    `counted`: the slave's counter that shows it, by at least `times`. `told`: the rule of a LimitEvent or the
    name of a SafetyEvent, empty where a counter is all. `armed`: the least share of the time in which the
    legitimate session is armed meanwhile; `ends`: the state after it.
    """

    counted: str = ""
    times: int = 1
    told: str = ""
    armed: float = 0.99
    ends: str = "armed"


@dataclass(slots=True)
class Outcome:
    """Outcome of an attack.

    `logged`: events of the log by name, None where there is no log. `wrong`: all that is not as it
    must be; empty: the attack was refused.
    """

    attack: str
    armed: float = 0.0
    ends: str = ""
    executed: int = 0
    counters: Mapping[str, int] = field(default_factory=dict)
    told: Mapping[str, int] = field(default_factory=dict)
    logged: Mapping[str, int] | None = None
    wrong: list[str] = field(default_factory=list)
    note: str = ""

    def judge(self, expected: Expected) -> "Outcome":
        """Compares with what must be."""
        self.require(self.executed == 0, f"{self.executed} forged commands executed")
        seen = self.counters.get(expected.counted, 0)
        if expected.counted:
            self.require(seen >= expected.times, f"{expected.counted}: {seen} of {expected.times}")
        if expected.told:
            self.require(expected.told in self.told, f"no event {expected.told}")
            if self.logged is not None:
                self.require(expected.told in self.logged, f"no {expected.told} in the event log")
        self.require(self.armed >= expected.armed, f"armed {self.armed:.0%}")
        self.require(self.ends == expected.ends, f"ends {self.ends}, not {expected.ends}")
        return self

    def require(self, condition: bool, otherwise: str) -> None:
        """Notes what is wrong."""
        if not condition:
            self.wrong.append(otherwise)

    def __str__(self) -> str:
        counted = ", ".join(f"{name} +{n}" for name, n in sorted(self.counters.items()) if n)
        told = ", ".join(f"{name} x{n}" for name, n in self.told.items())
        return "; ".join(filter(None, (counted, told, f"armed {self.armed:.0%}", self.note.strip(" ;,"))))
