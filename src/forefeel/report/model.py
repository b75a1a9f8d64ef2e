"""Models of report.json."""

from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from forefeel.common.error_size import ErrorSize
from forefeel.report.score import PredictionComparison, Spread
from forefeel.report.transparency import Transparency


class _Part(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ScoredCommands(_Part):
    """`sent` by the master; `answered` by a valid force; `scored`: answered, predicted, with a late force.

    `reasons`: of those that were not scored, each under one. not_followed: sent while the slave followed no
    command, before it engaged or after a stop. skipped: no force was measured while the slave executed it,
    for it was lost or refused, or a newer command overtook it. invalid_force: the force that answers it is
    not valid. not_predicted: there was no prediction or no received force in its tick.
    """

    sent: int = 0
    answered: int = 0
    scored: int = 0
    reasons: dict[str, int] = {}


class LoopFigures(_Part):
    """Lateness of a loop since its start, as published last; None when nothing was recorded."""

    p50_us: float | None = None
    p99_us: float | None = None
    max_us: float | None = None
    ticks: int | None = None
    missed: int | None = None
    scheduling: str | None = None


class Loops(_Part):
    master: LoopFigures = LoopFigures()
    slave: LoopFigures = LoopFigures()


class ParameterFigures(_Part):
    """One identified parameter as it was last; its unit stands in its name."""

    name: str
    value: float
    standard_deviation: float


class ModelFigures(_Part):
    """Progress of the identification, and the prior that it started from; None when nothing was recorded."""

    valid: bool | None = None
    samples: int | None = None
    updates: int | None = None
    resets: int | None = None
    innovation_rms_n: float | None = None
    prior: str | None = None


class PredictorFigures(_Part):
    """The predictor's 95 % band, and the share of the time for which each expert led.

    `coverage_95`: share of the scored commands whose force lay in the band; `band_width_n`: its mean width.
    """

    coverage_95: float | None = None
    band_width_n: float | None = None
    leading: dict[str, float] = {}


class SafetyNote(_Part):
    time_s: float
    before: str
    event: str
    after: str
    reason: str


class AxisReport(_Part):
    """One axis. What was not recorded is None, or empty.

    `transparency`: by the twin, None without a simulated world; `transparency_as_measured`: by the measured
    force. `hand_energy_j`: that the hand had put into the handle at
    the end, and at its lowest (negative: given). `hand_limited`: sentence on the limit that changed the force
    at the hand for 5 % of the commands or more. `settings`: that both ends agreed on, JSON. `calibrations`:
    that drivers of the slave had loaded, see `forefeel.common.messages.Calibration`.
    """

    axis: str | None = None
    commands: ScoredCommands = ScoredCommands()
    transparency: Transparency | None = None
    transparency_as_measured: Transparency | None = None
    prediction: ErrorSize = ErrorSize()
    zoh: ErrorSize = ErrorSize()
    ratio: float | None = None
    settled: PredictionComparison = PredictionComparison()
    predictor: PredictorFigures = PredictorFigures()
    hand_energy_j: float | None = None
    hand_lowest_energy_j: float | None = None
    hand_limited: str = ""
    delay_s: Spread = Spread()
    force_age_s: Spread = Spread()
    armed_share: float | None = None
    stops: int | None = None
    parameters: tuple[ParameterFigures, ...] = ()
    identifiable: tuple[str, ...] = ()
    model: ModelFigures = ModelFigures()
    counters: dict[str, int] = {}
    safety_events: tuple[SafetyNote, ...] = ()
    settings: str = ""
    calibrations: tuple[dict[str, str | float], ...] = ()
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
        """JSON text: keys in the order of the fields, None as null, never NaN."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"
