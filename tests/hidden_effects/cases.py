"""Which recordings are drawn: the ten of `make test`, the 400 of `make hidden-effects`."""

from dataclasses import dataclass

from tests.hidden_effects.generator import OUTSIDE_NAMES, VOCABULARY, Hidden, draw, drawn_pairs

QUARTER = 0.25


@dataclass(frozen=True)
class Case:
    """One recording to be drawn; `group` is the row of the summary that it counts in."""

    group: str
    kind: str
    seed: int
    size: float = 1.0
    longest_s: float = 60.0
    fastest_hz: float = 2000.0

    def drawn(self) -> Hidden:
        return draw(self.kind, self.seed, self.size, self.longest_s, self.fastest_hz)

    def __str__(self) -> str:
        return f"{self.kind}-{self.seed}" + ("" if self.size == 1.0 else "-quarter")


def full(first_seed: int = 50_000) -> list[Case]:
    s = first_seed
    return [
        *(Case("single", name, s + i) for name in VOCABULARY for i in range(6)),
        *(Case("quarter", name, s + 100 + i, QUARTER) for name in VOCABULARY for i in range(3)),
        *(Case("pair", kind, s + 200) for kind in drawn_pairs(s, 60)),
        *(Case("nothing", "nothing", s + 300 + i) for i in range(50)),
        *(Case("outside", name, s + 400 + i) for name in OUTSIDE_NAMES for i in range(3)),
        *(Case("pure_sine", "pure_sine", s + 500 + i) for i in range(25)),
        *(Case("constant_speed", "constant_speed", s + 600 + i) for i in range(15)),
        *(Case("standstill", "standstill", s + 700 + i) for i in range(7)),
    ]


def quick(seed: int = 90_000) -> list[Case]:
    """Ten short recordings: every verdict, and a cause of each kind of memory."""
    selected = (
        ("single", "coulomb_friction", 1), ("single", "stress_relaxation", 6), ("single", "time_delay", 9),
        ("single", "sensor_saturation", 12), ("single", "unmodelled_resonance", 15),
        ("pair", "bias+pulsation", 16), ("nothing", "nothing", 18), ("outside", "breathing_spring", 21),
        ("constant_speed", "constant_speed", 23), ("standstill", "standstill", 24),
    )  # fmt: skip
    return [
        Case(group, kind, seed + number, longest_s=16.0, fastest_hz=250.0) for group, kind, number in selected
    ]
