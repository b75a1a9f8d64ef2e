""" "Paper says / we get": the lines of the table, in words."""

from forefeel.studies.paper.bench import FIGURES
from forefeel.studies.paper.results import (
    BenchFigure,
    BoundedError,
    ErrorSummary,
    PaperComparison,
    SimulatedFigure,
    Unidentifiable,
    Windup,
)

# N of force, or a parameter in SI units, that counts as no difference: 1 % of the force of 1 N in figure 4
_COINCIDES_WITHIN = 0.01
# share of the time within the stated bound that counts as staying within it; chosen, not measured: larger
# lets single samples decide
_STABLE_SHARE = 0.95
# s by which a lead may differ from the delay: one sample at the 100 Hz of figures 4 and 5
_LEAD_WITHIN_S = 0.01


def comparisons(
    simulated: tuple[SimulatedFigure, ...],
    bench: tuple[BenchFigure, ...],
    unidentifiable: Unidentifiable,
    windup: Windup,
) -> tuple[PaperComparison, ...]:
    """One line for each thing that the paper states."""
    prompt, delayed = simulated
    return (
        _coincides(prompt),
        _parameters(unidentifiable),
        _leads(delayed),
        *(_bounded(figure) for figure in bench),
        _forgetting(windup),
    )


def _coincides(figure: SimulatedFigure) -> PaperComparison:
    size = figure.error.max_n
    return PaperComparison(
        subject="Figure 4: x = sin t, no delay",
        paper="prediction and measurement basically coincide",
        ours=f"largest error {_newton(size)} after one period",
        verdict="reproduced" if size is not None and size < _COINCIDES_WITHIN else "not reproduced",
    )


def _parameters(found: Unidentifiable) -> PaperComparison:
    true, ours = _named(found.true), _named(found.paper)
    close = max(abs(a - b) for a, b in zip(found.paper, found.true, strict=True)) < _COINCIDES_WITHIN
    return PaperComparison(
        subject="Figure 4: parameters",
        paper=f"simulated with {true}; recursion until the parameters converge",
        ours=f"converge to {ours}: only k - m ω² = {found.paper_combination_n_m:.3g} N/m is right",
        verdict="reproduced" if close else "wrong parameters, right force",
    )


def _named(theta: tuple[float, ...]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in zip("mbk", theta, strict=True))


def _leads(figure: SimulatedFigure) -> PaperComparison:
    leads = [abs(lead - figure.delay_s) < _LEAD_WITHIN_S for lead in (figure.lead_s, figure.newest_lead_s)]
    verdict = {
        (True, True): "reproduced",
        (True, False): "reproduced only when paired by stamps",
    }.get((leads[0], leads[1]), "not reproduced")
    return PaperComparison(
        subject=f"Figure 5: the same, {1e3 * figure.delay_s:.0f} ms delay",
        paper="the prediction leads the measured force",
        ours=f"leads by {1e3 * figure.lead_s:.0f} ms when paired by the slave's stamps; by "
        f"{abs(1e3 * figure.newest_lead_s):.0f} ms when the time lag is ignored, as the paper does "
        f"(then it errs by {_newton(figure.newest_error.rms_n)} rms)",
        verdict=verdict,
    )


def _bounded(figure: BenchFigure) -> PaperComparison:
    first, second = FIGURES[figure.instrument]
    prompt, late = figure.without_delay, figure.delayed
    stable = [
        one.share_within is not None and one.share_within >= _STABLE_SHARE
        for one in (prompt, late, figure.zoh)
    ]
    verdict = {
        (True, True, True): "reproduced, but the hold does it as well",
        (True, True, False): "reproduced",
    }.get(
        (stable[0], stable[1], stable[2]),
        "reproduced without a delay only" if stable[0] else "not reproduced",
    )
    return PaperComparison(
        subject=f"Figures {first}, {second}: {figure.instrument}, simulated bench",
        paper=f"error stable within 0-{1e3 * figure.stated_bound_n:.0f} mN",
        ours=f"without delay {_bound(prompt)}; {1e3 * figure.delay_s:.0f} ms late {_bound(late)}; "
        f"holding the late force {_bound(figure.zoh)}; the force itself is "
        f"{_newton(figure.force_rms_n)} rms, {_newton(figure.force_peak_n)} at most",
        verdict=verdict,
    )


def _forgetting(windup: Windup) -> PaperComparison:
    times = ", ".join(
        f"{row.forgetting_factor:g}: {'never' if row.overflow_s is None else f'{row.overflow_s:.3g} s'}"
        for row in windup.rows
    )
    ends = any(row.overflow_s is not None for row in windup.rows)
    return PaperComparison(
        subject="Forgetting factor",
        paper="0.95 to 0.99 recommended",
        ours=f"at {windup.rate_hz / 1e3:g} kHz on x = sin t the update overflows after ({times})",
        verdict="fails" if ends else "holds",
    )


def _bound(one: BoundedError) -> str:
    if one.share_within is None:
        return "nothing scored"
    return f"{100 * one.share_within:.0f} % of the time within, {_spread(one.error)}"


def _spread(error: ErrorSummary) -> str:
    return f"rms {_newton(error.rms_n)}, max {_newton(error.max_n)}"


def _newton(value: float | None) -> str:
    if value is None:
        return "no number"
    if abs(value) < 1e-6:
        return f"{value:.0e} N"
    return f"{1e3 * value:.3g} mN"
