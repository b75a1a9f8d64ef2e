"""Delays that are compared, and those that count at the patient. Pure."""

from collections.abc import Sequence

from forefeel.common.errors import ConfigurationError
from forefeel.diagnosis.evaluation.arrivals import DelayedLink

# Sentante, Dundee to Jacksonville, 2025; Consoli et al., AJNR 2025; Legeza et al. 2021, 65 cases; Consoli et
# al.: 49 of 51 uncontrolled movements were made at 450 ms and more
CLINICAL_DELAYS = (
    (0.12, "thrombectomy across the Atlantic, on a cadaver"),
    (0.25, "limit of robot-assisted neurovascular work"),
    (0.4, "perceived"),
    (0.45, "dangerous movements"),
)
"""Round trips in s, and what was done or seen there."""
CLINICAL_SOURCES = "Sentante 2025 (120 ms), Consoli, AJNR 2025 (250 and 450 ms), Legeza 2021 (400 ms)"

_SWEPT_MS = 20.0, 60.0, 120.0, 250.0, 300.0, 450.0, 600.0
_USUAL_S = 0.3  # of the demo and of the tables


def delayed_links(delays: str, jitter_s: float, loss: float, seed: int) -> tuple[DelayedLink, ...]:
    """Links by increasing delay. `delays`, in ms: `300` is one; `20:600` is both ends and those of 20, 60,
    120, 250, 300, 450 and 600 between them.

    Raises:
        ConfigurationError: any other text, the second end not above the first, or a value out of range.
    """
    try:
        ends = [float(end) for end in delays.split(":")]
    except ValueError:
        ends = []
    if not 1 <= len(ends) <= 2 or ends != sorted(set(ends)):
        raise ConfigurationError(f"delays = {delays!r}: expected ms, as 300, or a range of them, as 20:600")
    between = [ms for ms in _SWEPT_MS if ends[0] < ms < ends[-1]]
    return tuple(DelayedLink(1e-3 * ms, jitter_s, loss, seed) for ms in sorted({*ends, *between}))


def most_usual(links: Sequence[DelayedLink]) -> DelayedLink:
    """The one whose delay is nearest to 300 ms: over it, an evaluation is shown in detail."""
    return min(links, key=lambda link: abs(link.delay_s - _USUAL_S))
