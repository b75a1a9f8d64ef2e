"""Which recordings are drawn: the quick set of `make test`, the 400 of `make hidden-effects`."""

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
        """The recording with its truth."""
        return draw(self.kind, self.seed, self.size, self.longest_s, self.fastest_hz)

    def __str__(self) -> str:
        return f"{self.kind}-{self.seed}" + ("" if self.size == 1.0 else "-quarter")


def full(first_seed: int = 50_000) -> list[Case]:
    """400 recordings."""
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
    """25 short recordings: names of every kind of memory, and every verdict."""
    singles = (
        "bias", "coulomb_friction", "presliding_hysteresis", "backlash", "stiffening", "quadratic_drag",
        "stress_relaxation", "contact_loss", "stiffness_change", "time_delay", "sensor_lag", "sensor_drift",
        "sensor_saturation", "sensor_quantisation", "pulsation", "unmodelled_resonance",
    )  # fmt: skip
    others = (
        *(("pair", kind) for kind in ("bias+pulsation", "coulomb_friction+sensor_drift")),
        ("nothing", "nothing"), ("nothing", "nothing"),
        ("outside", "position_ripple"), ("outside", "breathing_spring"),
        ("pure_sine", "pure_sine"), ("constant_speed", "constant_speed"), ("standstill", "standstill"),
    )  # fmt: skip
    chosen = [*(("single", name) for name in singles), *others]
    return [
        Case(group, kind, seed + n, longest_s=16.0, fastest_hz=250.0)
        for n, (group, kind) in enumerate(chosen)
    ]
