"""Prior of a contact, from one session for the next: means and covariance of named parameters.

The covariance contains the noise only; `widened` adds the change of a vessel from day to day.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.path_force import PathForce

Array = NDArray[np.float64]

CONTACT = "contact_loss.contact_position_m"

# Standard deviation of a parameter between two sessions, relative to its value; of the contact in m.
_SHARES = {"heart.frequency_hz": 0.10, "breath.frequency_hz": 0.15, "stress_relaxation.time_constant_s": 0.3}
_SHARE = 0.25
_CONTACT_M = 0.002
_LINEAR = re.compile(r"^(?!bias|noise).*_(n|kg)(_|$)")
"""Names of the parameters that scale with the force, by unit; an offset of the cell is none."""
_SURE = 1e-3  # relative standard deviation of a value that is taken as given


@dataclass(frozen=True, slots=True)
class ContactPrior:
    """Means and covariance of a contact's parameters.

    Attributes:
        names: `cause.parameter_unit`, each once.
        values: in the unit that each name ends in.
        covariance: symmetric and positive definite, rows in the order of the names.
        contact_s: seconds of contact from which it was learned.
        path: the force by place, where that was better than the parameters.

    Raises:
        ValueError: of another shape, not finite, or not a covariance; one line.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    contact_s: float
    path: PathForce | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        if (
            len(set(self.names)) != n
            or len(self.values) != n
            or [len(row) for row in self.covariance] != [n] * n
        ):
            raise ValueError(f"{n} names: expected them to differ, {n} values and {n} x {n} covariances")
        if not all(map(isfinite, (*self.values, *sum(self.covariance, ()), self.contact_s))):
            raise ValueError("expected finite values and covariances")
        if self.contact_s < 0.0 or not _positive_definite(np.array(self.covariance).reshape(n, n)):
            raise ValueError(
                "expected a symmetric positive definite covariance and a time in contact of 0 or more"
            )

    @property
    def standard_deviations(self) -> tuple[float, ...]:
        return tuple(self.covariance[i][i] ** 0.5 for i in range(len(self.names)))


def exactly(means: Mapping[str, float]) -> ContactPrior:
    """Prior with these means and hardly any spread, 0.1 %; see `widened`."""
    size = [max(_SURE * abs(value), 1e-12) for value in means.values()]
    return ContactPrior(tuple(means), tuple(means.values()), _rows(np.diag(np.square(size))), 0.0)


def joined(first: ContactPrior, second: ContactPrior) -> ContactPrior:
    """Returns the first prior with those parameters of the second that it lacks, uncorrelated with its own.

    The time in contact and the force by place are those of the first.
    """
    more = [i for i, name in enumerate(second.names) if name not in first.names]
    n, covariance = len(first.names), np.zeros((len(first.names) + len(more),) * 2)
    covariance[:n, :n] = np.array(first.covariance).reshape(n, n)
    covariance[n:, n:] = np.array(second.covariance)[np.ix_(more, more)]
    names = (*first.names, *(second.names[i] for i in more))
    values = (*first.values, *(second.values[i] for i in more))
    return ContactPrior(names, values, _rows(covariance), first.contact_s, first.path)


def widened(prior: ContactPrior, by: float) -> ContactPrior:
    """Copy of the prior with `by` times the usual spread between two sessions of one patient added to it."""
    covariance = np.array(prior.covariance).reshape(len(prior.names), len(prior.names))
    for i, (name, value) in enumerate(zip(prior.names, prior.values, strict=True)):
        spread = _CONTACT_M if name == CONTACT else _SHARES.get(name, _SHARE) * abs(value)
        covariance[i, i] += (by * spread) ** 2
    return replace(prior, covariance=_rows(covariance))


def force_ratio(prior: ContactPrior, learned: ContactPrior) -> float:
    """Learned forces over those of the prior for the same motion: the slope a' C^-1 b / a' C^-1 a of the
    linear parameters b on those of the prior, a; 1 if there are none. C: covariance of b.
    """
    at = [i for i, name in enumerate(learned.names) if name in prior.names and _LINEAR.search(name)]
    values = dict(zip(prior.names, prior.values, strict=True))
    a, b = np.array([(values[learned.names[i]], learned.values[i]) for i in at]).reshape(-1, 2).T
    weights = np.linalg.solve(np.array(learned.covariance)[np.ix_(at, at)], a)
    return float(weights @ b / (weights @ a)) if a.any() else 1.0


def _rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


def _positive_definite(covariance: Array) -> bool:
    """True if a covariance is symmetric, and its correlations are positive definite beyond rounding. False if
    a variance is not above 0.
    """
    size = np.sqrt(np.clip(np.diagonal(covariance), 0.0, None))
    if not (size > 0.0).all():
        return False
    correlation = covariance / np.outer(size, size)
    symmetric = np.allclose(correlation, correlation.T, rtol=0.0, atol=1e-9)
    return bool(symmetric and (np.linalg.eigvalsh(correlation) > 1e-12).all())
