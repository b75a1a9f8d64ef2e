"""Statements on the parameters that the motion leaves undetermined, in plain words.

From the information matrix R = sum w phi phi' of the scaled regressors (w: forgetting weights; one sample of
nominal size counts 1). A parameter with R_ii < 1 is not excited. Among the others the directions eta with R
eta = 0 (relative to the diagonal) are free: theta and theta + s eta fit alike, so of a pair (i, j) only
theta_j - (eta_j / eta_i) theta_i is known. For x = sin(w t) these are m and k, known as k - w^2 m only.

Reference: Ljung, System Identification (1999), ch. 4.5 and 13.2; Belsley, Kuh and Welsch, Regression
Diagnostics (1980), ch. 3.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_INFORMATION = 1.0  # one sample of nominal size, the unit of R (see above); less counts as not excited
_COLLINEAR = 1e-4
"""Relative eigenvalue below which a direction is free.

Encoder noise seems to inform, too. With steps of 1 um, strokes of 4 mm and a cutoff of 10 Hz, a sinusoid of
0.5 Hz is still recognised; at 0.3 Hz the noise in a_f makes m and k look separate.
"""

_NEGLIGIBLE = 0.05
"""Part of a parameter in a free direction that is not mentioned."""

MAX_STATEMENTS = 4  # texts in a result
MAX_LENGTH = 200  # characters of a text; within the 256 of `messages.ShortText`


def analyse(gathered: Array, names: Sequence[str], scales: Sequence[float]) -> tuple[str, ...]:
    """Describes what `gathered`, the information matrix of the scaled regressors, leaves undetermined.

    Args:
        gathered: R, shape (n, n), symmetric.
        names: n parameter names, used as they are in the statements.
        scales: the n magnitudes that the regressors were divided by.

    Returns:
        At most MAX_STATEMENTS texts of at most MAX_LENGTH characters; none where all is determined.
    """
    excited = [i for i in range(len(names)) if gathered[i, i] >= LEAST_INFORMATION]
    quiet = [i for i in range(len(names)) if i not in excited]
    texts = [f"{_listed([names[i] for i in quiet])} not excited"] if quiet else []
    for direction in _free_directions(gathered, excited, np.asarray(scales)):
        texts.append(_describe(direction, names))
    if len(texts) > MAX_STATEMENTS:
        texts[MAX_STATEMENTS - 1 :] = [f"{len(texts) - MAX_STATEMENTS + 1} more combinations not determined"]
    return tuple(map(_cut, texts))


def _free_directions(gathered: Array, excited: list[int], scales: Array) -> list[dict[int, float]]:
    """Returns the changes of the parameters in `excited` that the data do not determine: independent, each
    {index: component} in units of the parameters, as sparse as can be. Empty if all are determined.
    """
    if not excited:
        return []
    size = np.sqrt(np.diag(gathered)[excited])
    eigenvalues, vectors = np.linalg.eigh(gathered[np.ix_(excited, excited)] / np.outer(size, size))
    basis = _sparse(vectors[:, eigenvalues < _COLLINEAR].T)
    to_theta = 1.0 / (size * scales[excited])
    return [
        {excited[i]: float(row[i] * to_theta[i]) for i in np.flatnonzero(np.abs(row) > _NEGLIGIBLE)}
        for row in basis
    ]


def _sparse(basis: Array) -> Array:
    """Returns a basis of the same row space with zeros where possible, by Gauss-Jordan with largest pivots.
    The largest entry of each row is 1 in size; an empty basis gives an empty one.
    """
    rows = basis.copy()
    for i in range(len(rows)):
        pivot_row, pivot = np.unravel_index(int(np.argmax(np.abs(rows[i:]))), rows[i:].shape)
        rows[[i, i + int(pivot_row)]] = rows[[i + int(pivot_row), i]]
        rows[i] /= rows[i, pivot]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, pivot], rows[i])
    return np.asarray(rows / np.abs(rows).max(axis=1, keepdims=True) if len(rows) else rows)


def _describe(direction: dict[int, float], names: Sequence[str]) -> str:
    """Returns the statement on a free direction: on a parameter, on the combination of a pair, or on several.

    `direction`: {index in `names`: component}. Of a pair it says which sum or difference is known.
    """
    involved = [names[i] for i in direction]
    if len(direction) == 1:
        return f"{involved[0]} not determined"
    if len(direction) > 2:
        return f"{_listed(involved)} not separable"
    (_, eta_i), (_, eta_j) = direction.items()
    ratio = -eta_j / eta_i
    sign = "+" if ratio > 0.0 else "-"
    return f"{_listed(involved)} only as {involved[1]} {sign} {abs(ratio):#.3g} {involved[0]}"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _cut(text: str) -> str:
    return text if len(text) <= MAX_LENGTH else f"{text[: MAX_LENGTH - 4]} ..."
