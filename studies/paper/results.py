"""What reproduction.json holds: every number of the page, None where there is none."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from forefeel.studies.paper.contact import Array, rms


class Part(BaseModel):
    """Frozen; unknown fields, NaN and infinity are refused."""

    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ErrorSummary(Part):
    """Root mean square, 95 % quantile and maximum of an error; None: nothing scored, or it diverged."""

    rms_n: float | None = None
    p95_n: float | None = None
    max_n: float | None = None


class SimulatedFigure(Part):
    """Figure 4 or 5. Errors against the true force of the same instant, from `scored_from_s` on.

    `lead_s`: of the prediction before the force that has arrived; `newest_*`: late forces paired with the
    newest motion instead of that of their own stamp. `siso_error`: equations (3) to (7) with na = nb = 2,
    carried on over the delay.
    """

    figure: int
    delay_s: float
    rate_hz: float
    forgetting_factor: float
    scored_from_s: float
    mass_kg: float
    damping_n_s_m: float
    stiffness_n_m: float
    error: ErrorSummary
    lead_s: float
    newest_error: ErrorSummary
    newest_lead_s: float
    siso_error: ErrorSummary


class BoundedError(Part):
    """An error and the share of the time in which it is within the bound that the paper states."""

    error: ErrorSummary
    share_within: float | None


class BenchFigure(Part):
    """Figures 7 and 8 (catheter) or 9 and 10 (guidewire), on the simulated bench."""

    figures: tuple[int, int]
    instrument: str
    stated_bound_n: float
    delay_s: float
    round_trip_s: float
    scored_s: float
    force_rms_n: float | None
    force_peak_n: float
    without_delay: BoundedError
    delayed: BoundedError
    zoh: BoundedError
    product: BoundedError
    delayed_rms_by_rate_hz: dict[str, float | None]


class AmplitudeRow(Part):
    """Force amplitude for a motion of 1 m at this frequency: true, and by what was learned at 1 rad/s."""

    omega_rad_s: float
    true_n: float
    paper_n: float
    product_n: float
    product_two_frequencies_n: float


class Unidentifiable(Part):
    """(a) With x = sin t only k - m w^2 is known. Parameters are m, b, k in SI units."""

    rate_hz: float
    duration_s: float
    true: tuple[float, ...]
    paper: tuple[float, ...]
    paper_error: ErrorSummary
    true_combination_n_m: float
    paper_combination_n_m: float
    amplitudes: tuple[AmplitudeRow, ...]
    product: tuple[float, ...]
    product_says: tuple[str, ...]
    second_omega_rad_s: float
    paper_two_frequencies: tuple[float, ...]
    product_two_frequencies: tuple[float, ...]
    product_says_two_frequencies: tuple[str, ...]


class WindupRow(Part):
    """(b) One forgetting factor at 1 kHz.

    `overflow_s` measured without noise, `expected_s` from lambda^-k / delta alone, `unsymmetrised_s` as the
    paper writes (10). With noise: the median over the seeds of when a parameter first exceeds the limit,
    and the largest parameter of all seeds.
    """

    forgetting_factor: float
    overflow_s: float | None
    expected_s: float
    unsymmetrised_s: float | None
    noisy_exceeds_s: float | None
    noisy_largest: float


class Windup(Part):
    """(b) The covariance in the unexcited direction grows as lambda^-k until the numbers overflow."""

    rate_hz: float
    noise_n: float
    limit: float
    seeds: int
    rows: tuple[WindupRow, ...]
    product_duration_s: float
    product_largest: float
    product_largest_noisy: float
    product_trace_growth: float


class MemoryRow(Part):
    """(c) One sample rate: rms of the prediction, median of the seeds with the lowest and the highest.

    `known_mass_rms_n`: the paper's algorithm for b and k alone, which x = sin t does identify.
    """

    rate_hz: float
    memory_s: float
    paper_rms_n: float
    paper_lowest_n: float
    paper_highest_n: float
    known_mass_rms_n: float
    product_rms_n: float


class MemoryResult(Part):
    """(c) A forgetting factor is a memory in samples, whatever the rate."""

    noise_n: float
    delay_s: float
    duration_s: float
    forgetting_factor: float
    seeds: int
    product_memory_s: float
    rows: tuple[MemoryRow, ...]


class UnmodelledRow(Part):
    """(d) An unmodelled force in the paper's simulation: rms of the prediction's error.

    `ordinary_rms_n`: lambda = 1, whose limit `expected_n` is known in closed form.
    """

    what: Literal["bias", "friction"]
    size_n: float
    paper_rms_n: float
    ordinary_rms_n: float
    expected_n: float
    product_rms_n: float


class Unmodelled(Part):
    """(d) Neither a bias nor friction in the model."""

    rate_hz: float
    delay_s: float
    forgetting_factor: float
    rows: tuple[UnmodelledRow, ...]


class BaselineRow(Part):
    """(e) and (f) One run: errors at the stamps of the slave, in N (or the force's unit in the recording).

    `newest`: the paper's algorithm with late forces paired with the newest motion. `tared`: paired by stamps,
    of the force less its first value, as if the load cell had been set to zero at the start.
    """

    name: str
    source: Literal["simulated bench", "recording"]
    scored: int
    scored_s: float
    force_rms_n: float | None
    zoh: ErrorSummary
    paper: ErrorSummary
    newest: ErrorSummary
    tared: ErrorSummary
    product: ErrorSummary
    paper_over_zoh: float | None
    newest_over_zoh: float | None
    tared_over_zoh: float | None
    product_over_zoh: float | None


class Baseline(Part):
    """(e) No hold baseline. `skipped`: recordings that could not be used, and why."""

    delay_s: float
    rows: tuple[BaselineRow, ...]
    recordings_given: bool
    skipped: dict[str, str]


class Pairing(Part):
    """(f) The paper's simulation; the runs are the rows of the baseline.

    Against sin t the wrong pairing learns the delayed force: its error is that of a hold, `expected_n`.
    """

    delay_s: float
    stamps_rms_n: float | None
    newest_rms_n: float | None
    product_rms_n: float | None
    zoh_rms_n: float | None
    expected_n: float


class ThresholdRow(Part):
    """One method on one run of the simulated bench: the error that the hand would be shown.

    Shares of the scored time in which it is not felt: `strict` below the larger of 29 mN and 7 % of the
    force, `lenient` below the larger of 44 mN and 10 %; `absolute` below 29 mN, `relative` below 7 % alone.
    """

    instrument: str
    style: str
    method: Literal["zoh", "paper", "product"]
    force_scale: float
    scored_s: float
    error_at_hand: ErrorSummary
    strict_share: float | None
    lenient_share: float | None
    absolute_share: float | None
    relative_share: float | None


class Thresholds(Part):
    """The error beside what a finger can feel. `styles`: settings of the simulated operator that differ."""

    relative: tuple[float, float]
    absolute_n: tuple[float, float]
    styles: dict[str, dict[str, float]]
    rows: tuple[ThresholdRow, ...]


class Flaws(Part):
    """The six things that the paper's simulation gets wrong."""

    unidentifiable: Unidentifiable
    windup: Windup
    memory: MemoryResult
    unmodelled: Unmodelled
    baseline: Baseline
    pairing: Pairing


class PaperComparison(Part):
    """One line of "paper says / we get"."""

    subject: str
    paper: str
    ours: str
    verdict: str


class Reproduction(Part):
    """reproduction.json."""

    format: Annotated[Literal["forefeel.reproduction/1"], Field(alias="schema")] = "forefeel.reproduction/1"
    delay_s: float
    seed: int
    comparisons: tuple[PaperComparison, ...]
    simulated: tuple[SimulatedFigure, ...]
    bench: tuple[BenchFigure, ...]
    flaws: Flaws
    thresholds: Thresholds
    notes: tuple[str, ...]

    def to_json(self) -> str:
        """As JSON text: keys in the order of the fields, None as null, never NaN."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


def error_size(predicted_n: Array, force_n: Array) -> ErrorSummary:
    """Size of `predicted_n - force_n`; None when there is nothing, or when it is not finite throughout."""
    size = np.abs(predicted_n - force_n)
    total = rms(size)
    if total is None:
        return ErrorSummary()
    return ErrorSummary(rms_n=total, p95_n=float(np.quantile(size, 0.95)), max_n=float(size.max()))


def ratio(part: ErrorSummary, whole: ErrorSummary) -> float | None:
    """rms over rms; None where either is missing, the second is 0, or no float holds it."""
    if part.rms_n is None or not whole.rms_n:
        return None
    value = part.rms_n / whole.rms_n
    return value if np.isfinite(value) else None
