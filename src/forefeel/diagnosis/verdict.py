"""The result of a diagnosis, as diagnosis.json holds it (schema forefeel.diagnosis/3)."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import sqrt
from typing import Literal

from forefeel.common.causes.catalogue import cause_class

SCHEMA = "forefeel.diagnosis/3"

VerdictName = Literal[
    "nothing_missing",
    "nothing_found",
    "cause_found",
    "partly_explained",
    "not_separable",
    "not_driven_by_this_axis",
    "unexplained",
]
LEAST_S = 3.0
"""Shortest recording that is diagnosed."""
MOST_TIMES_THE_NOISE = 3.0
"""Times the noise that a simulation which is complete leaves at most."""
NAMING: frozenset[VerdictName] = frozenset({"cause_found", "partly_explained"})
"""Verdicts that name causes."""
SLOW = "slow_force"
"""Flag of a force that is slower than the strokes, beside which the search names what is slow."""
Family = Literal["friction", "relaxation", "stiffening"]


@dataclass(frozen=True, slots=True)
class Interval:
    """A parameter in the unit of its name, with its 95 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def about(cls, value: float, doubt: float) -> "Interval":
        """Interval from `value` - `doubt` to `value` + `doubt`."""
        return cls(float(value), float(value - doubt), float(value + doubt))


@dataclass(frozen=True, slots=True)
class HeldOut:
    """rms on held-out blocks in N before and after; 1 - after / before with its block-bootstrap interval."""

    rmse_before_n: float
    rmse_after_n: float
    gain: float
    gain_low: float
    gain_high: float


@dataclass(frozen=True, slots=True)
class Evidence:
    """Fingerprint of a cause, fall of the penalised -2 log likelihood with it, and its held-out gain."""

    fingerprint: str
    likelihood: float
    gain: float
    gain_low: float
    gain_high: float
    words: str


@dataclass(frozen=True, slots=True)
class Cause:
    """One named cause; `gain_n`: by how much the held-out rms falls with it, in N; `explained_n`: its rms;
    `column`: of the recording, which it follows, if it follows one.
    """

    name: str
    parameters: dict[str, Interval]
    evidence: Evidence
    gain_n: float
    explained_n: float
    column: str = ""

    @classmethod
    def fitted(
        cls,
        name: str,
        parameters: dict[str, Interval],
        likelihood: float,
        held_out: HeldOut,
        words: str,
        column: str = "",
    ) -> "Cause":
        """Cause of a fitted model; `held_out`: errors without it and with it, from which its gain and
        `explained_n` follow. `likelihood`: fall of the penalised -2 log likelihood with it.
        """
        before_n, after_n, gain = held_out.rmse_before_n, held_out.rmse_after_n, held_out.gain
        evidence = Evidence(
            cause_class(name).fingerprint, likelihood, gain, held_out.gain_low, held_out.gain_high, words
        )
        explained_n = sqrt(max(before_n**2 - after_n**2, 0.0))
        return cls(name, parameters, evidence, before_n - after_n, explained_n, column)

    @classmethod
    def on_readings(cls, name: str, parameters: dict[str, Interval], words: str, rms_n: float) -> "Cause":
        """A fault of the sensor, of which the readings are freed before models are compared."""
        return cls(
            name, parameters, Evidence(cause_class(name).fingerprint, 0.0, 0.0, 0.0, 0.0, words), 0.0, rms_n
        )


@dataclass(frozen=True, slots=True)
class ModelError:
    """rms of the residual in N of a model, and its parameters.

    `fit_percent`: 100 (1 - rms / standard deviation of the force), the normalised root mean square (NRMSE) of
    MATLAB's `compare`. `intervals`: of mass, damping and stiffness; none where the model was given.
    """

    rmse_n: float
    parameters: dict[str, float]
    fit_percent: float
    intervals: dict[str, Interval] = field(default_factory=dict)

    @classmethod
    def of(cls, rmse_n: float, force_n: float, parameters: Mapping[str, dict[str, Interval]]) -> "ModelError":
        """Error of a model; `parameters` by cause, "" (mass, damping, stiffness) among them, become values
        named `cause.parameter`; intervals are kept of "" alone. `force_n`: standard deviation of the force.
        """
        values = {
            f"{name}.{key}" if name else key: interval.value
            for name, intervals in parameters.items()
            for key, interval in intervals.items()
        }
        return cls(rmse_n, values, 100.0 * (1.0 - rmse_n / force_n), dict(parameters[""]))


@dataclass(frozen=True, slots=True)
class ExpectedGain:
    """1 - rms after / rms before to expect of another motion, with its 95 % interval; within the range of
    position in m and up to the speed in m/s that were recorded.
    """

    gain: float
    gain_low: float
    gain_high: float
    low_m: float
    high_m: float
    fastest_m_s: float


@dataclass(frozen=True, slots=True)
class Look:
    """Result of plain regressions on a recording; shares of the force's variance on held-out blocks.

    Attributes:
        sense: +1 where a positive force resists, -1 where the recording shows the reaction.
        slow_hz: what is slower than the strokes, in Hz.
        spring, spring_in_band: explained by mass, damper and spring, in the whole band and above `slow_hz`.
        explained: by the best of the families, in the better band.
        family: which takes most of what mass, damper and spring leave; None where none takes a quarter.
        pushes_away: whether the spring may be negative (a weight that stands upright, a magnet).
    """

    sense: float
    slow_hz: float
    spring: float
    spring_in_band: float
    explained: float
    family: Family | None
    pushes_away: bool = False


@dataclass(frozen=True, slots=True)
class NextMotion:
    """Motion to record next: in words, None of which is that of `forefeel investigate`; its duration and
    place, None of which is wherever it was.
    """

    words: str | None
    duration_s: float
    low_m: float | None = None
    high_m: float | None = None


@dataclass(frozen=True, slots=True)
class Follows:
    """A variable that what is left follows, and the share of its variance on held-out blocks; `low_m`,
    `high_m`: between which four fifths of it stand.
    """

    variable: str
    share: float
    low_m: float
    high_m: float


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Everything that diagnosis.json says. `suspected`: what the search named even when the verdict is less.
    `noise_floor_n`: None where the recording does not tell it. `other_motion`: None without a cause whose
    gain depends on the motion. `look`: None where the motion is no strokes. `detectable`: least sizes, as
    `cause.parameter`, that would have shown where nothing is named.
    """

    verdict: VerdictName
    causes: tuple[Cause, ...]
    rivals: tuple[tuple[str, ...], ...]
    next_motion: NextMotion | None
    flags: tuple[str, ...]
    noise_floor_n: float | None
    baseline: ModelError
    extended: ModelError
    held_out: HeldOut
    other_motion: ExpectedGain | None = None
    look: Look | None = None
    follows: tuple[Follows, ...] = ()
    detectable: dict[str, float] = field(default_factory=dict)
    suspected: tuple[str, ...] = field(default=())

    @property
    def names_causes(self) -> bool:
        return self.verdict in NAMING

    @property
    def has_a_model(self) -> bool:
        """True where causes are named, or no sign of any was found: its model can be held against others."""
        return bool(self.causes) or self.verdict in {"nothing_missing", "nothing_found"}

    def to_mapping(self) -> dict[str, object]:
        return {"schema": SCHEMA, **asdict(self)}
