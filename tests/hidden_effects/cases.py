"""Which recordings are drawn: a short one of each name in `make test`, the 400 of `make hidden-effects`."""

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
    slowest_hz: float = 50.0
    motion: str = ""

    def drawn(self) -> Hidden:
        return draw(
            self.kind, self.seed, self.size, self.longest_s, self.fastest_hz, self.slowest_hz, self.motion
        )

    def __str__(self) -> str:
        return f"{self.kind}-{self.seed}" + ("-quarter" if self.size == QUARTER else "")


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


QUICK = {
    **dict.fromkeys(VOCABULARY, "single"), "position_ripple": "outside", "acceleration_sign": "outside",
    "nothing": "nothing", "constant_speed": "constant_speed", "standstill": "standstill",
}  # fmt: skip
"""Groups by kind of recording: every name of the vocabulary and every verdict without one."""
_SIZES = {
    **dict.fromkeys(("backlash", "mains_hum", "pulsation", "sensor_lag", "sensor_saturation"), 1.0),
    "sensor_quantisation": 0.5,
}
"""Larger ones leave little of the force, or are taken for something else."""


def quick(kind: str, seed: int) -> Case:
    """Plain case that costs a second: 10 s of a hand at 500 Hz, effects of twice the size; a breath
    takes longer to be told from strokes.
    """
    longest_s = 40.0 if kind == "pulsation" else 10.0
    return Case(QUICK[kind], kind, seed, _SIZES.get(kind, 2.0), longest_s, 500.0, 500.0, "hand")
