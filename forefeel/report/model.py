"""What report.json holds."""

from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from forefeel.common.error_size import ErrorSize
from forefeel.report.score import ErrorRatio, PredictionComparison, Spread
from forefeel.report.transparency import Transparency


class _Part(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class NotJudged(_Part):
    """Commands that were sent and not scored, each counted under one reason.

    Attributes:
        not_followed: sent while the slave followed no command: before it engaged, after a stop.
        skipped: no force was measured while the slave executed it: it was lost or refused, a newer command
            came before it was executed, or the load cell reads less often than commands come.
        invalid_force: the force that answers it is not valid.
        not_predicted: answered, but there was no prediction or no received force in its tick.
    """

    not_followed: int = 0
    skipped: int = 0
    invalid_force: int = 0
    not_predicted: int = 0


class ScoredCommands(_Part):
    """`sent` by the master; `answered` by a valid force; `scored`: answered, predicted and with a zoh.

    `sent` is `scored` and `not_judged` together; `reasons` add up to `not_judged`.
    """

    sent: int = 0
    answered: int = 0
    scored: int = 0
    not_judged: int = 0
    reasons: NotJudged = NotJudged()
    answered_share: float | None = None
    scored_share: float | None = None


class LoopFigures(_Part):
    """Lateness of a loop since its start, from its last word; None when it said nothing."""

    p50_us: float | None = None
    p99_us: float | None = None
    max_us: float | None = None
    ticks: int | None = None
    missed: int | None = None
    scheduling: str | None = None


class Loops(_Part):
    master: LoopFigures = LoopFigures()
    slave: LoopFigures = LoopFigures()


class ClockFigures(_Part):
    """The slave's clock minus the master's, true to within +-`bound_s`; as the master knew it last."""

    offset_s: float | None = None
    bound_s: float | None = None
    grade: Literal["good", "acceptable", "poor", "unknown"] = "unknown"


class ParameterFigures(_Part):
    """One identified parameter as it was last; its unit stands in its name."""

    name: str
    value: float
    standard_deviation: float


class ModelFigures(_Part):
    """How far the identification came, and what prior it started from; None when it said nothing."""

    valid: bool | None = None
    samples: int | None = None
    updates: int | None = None
    resets: int | None = None
    innovation_rms_n: float | None = None
    prior: str | None = None


class PredictorFigures(_Part):
    """What the predictor said of itself: its 95 % band, and which expert led for which share of the time.

    `coverage_95`: share of the scored commands whose force lay in the band; `band_width_n`: its mean width.
    """

    coverage_95: float | None = None
    band_width_n: float | None = None
    leading: dict[str, float] = {}


class HandFigures(_Part):
    """Energy in J that the hand had put into the handle: at the end, and at its lowest (negative: given)."""

    energy_j: float | None = None
    lowest_energy_j: float | None = None


class SafetyNote(_Part):
    """One transition of the slave's safety state."""

    time_s: float
    before: str
    event: str
    after: str
    reason: str


class CalibrationFigures(_Part):
    """A calibration that a driver of the slave had loaded, see `forefeel.common.messages.Calibration`."""

    slot: str
    driver: str
    serial: str
    date: str
    zero: float
    gain_n: float | None
    residual_n: float | None
    hysteresis_n: float | None
    native_per_m: float | None
    repeatability_m: float | None


class AxisReport(_Part):
    """One axis. What was not recorded is None, or empty. `transparency`: None without a simulated world."""

    axis: str | None = None
    commands: ScoredCommands = ScoredCommands()
    transparency: Transparency | None = None
    prediction: ErrorSize = ErrorSize()
    zoh: ErrorSize = ErrorSize()
    ratio: ErrorRatio = ErrorRatio()
    settled: PredictionComparison = PredictionComparison()
    predictor: PredictorFigures = PredictorFigures()
    hand: HandFigures = HandFigures()
    delay_s: Spread = Spread()
    force_age_s: Spread = Spread()
    armed_share: float | None = None
    stops: int | None = None
    clock: ClockFigures = ClockFigures()
    parameters: tuple[ParameterFigures, ...] = ()
    identifiable: tuple[str, ...] = ()
    model: ModelFigures = ModelFigures()
    counters: dict[str, int] = {}
    safety_events: tuple[SafetyNote, ...] = ()
    settings: dict[str, str] = {}
    calibrations: tuple[CalibrationFigures, ...] = ()
    samples: dict[str, int] = {}
    notes: tuple[str, ...] = ()


class _RunFields(_Part):
    format: Annotated[Literal["forefeel.report/1"], Field(alias="schema")] = "forefeel.report/1"
    recording: str = ""
    cell: str | None = None
    duration_s: float = 0.0
    truncated: bool = False
    seed: str | None = None
    impairment: str | None = None
    loop: Loops = Loops()


class RunReport(AxisReport, _RunFields):
    """The whole run: its own fields, those of its first axis, and every axis in `axes`.

    `format` is called `schema` in JSON. `seed` and `impairment` are those of the metadata table `run`.
    `counters` counts what the injected impairment did, too.
    """

    metadata: dict[str, dict[str, str]] = {}
    axes: dict[str, AxisReport] = {}

    def to_json(self) -> str:
        """As JSON text: keys in the order of the fields, None as null, never NaN."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"
