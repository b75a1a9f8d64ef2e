"""A long recording in chunks: one fit to all of them by accumulated normal equations.

No chunk is kept: each leaves the sums `J' J`, `J' y`, `y' y` of whitened rows (J with the derivatives by the
shapes) and those of plain rows. Coefficients, a Gauss-Newton step of the shapes, intervals and the errors of
blocks that were held out follow from the sums (recursive least squares in blocks: Bjoerck, Numerical Methods
for Least Squares Problems, 1996, 6.2). The memory of an effect begins anew in every chunk, as after a gap.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from forefeel.common.causes.candidate import Shape
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.blocks import RmsGain, plain_columns
from forefeel.diagnosis.diagnose.parameters import intervals_by, jacobian_of
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.diagnose.signals import Mask, Signals
from forefeel.diagnosis.diagnose.verdict import Interval

_DRAWS = 1000
_BLOCKS = 16
_SEEN = 0.2
_FARTHEST = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """Of one chunk: whitened `J' J`, `J' y`, `y' y` and rows, then the plain ones without shapes."""

    gram: Floats
    moment: Floats
    square: float
    rows: int
    plain_gram: Floats
    plain_moment: Floats
    plain_square: float
    plain_rows: int

    def plain_error(self, theta: Floats) -> float:
        """Sum of squared errors in N^2 of these coefficients."""
        linear = theta[: len(self.plain_moment)]
        bent = float(linear @ self.plain_gram @ linear) - 2.0 * float(linear @ self.plain_moment)
        return max(self.plain_square + bent, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """The chunks of a recording, to be conditioned one after the other.

    `recording`: cleaned; `unusable`: its clipped samples. `like`: the regression of a part, whose band,
    noise, extent and sense are used everywhere. `parts_s`: as of the regression.
    """

    recording: Recording
    unusable: Mask
    chunks: Sequence[slice]
    like: RecordingRegression
    parts_s: tuple[float, ...] = ()

    def blocks(self, numbers: Iterable[int]) -> list[list[int]]:
        """What is held out at once, of these chunks: whole recordings, or sixteen blocks of one."""
        known = sorted(numbers)
        if not self.parts_s:
            return [block.tolist() for block in np.array_split(known, min(_BLOCKS, len(known)))]
        start_s = [
            float(self.recording.time_s[self.chunks[k].start] - self.recording.time_s[0]) for k in known
        ]
        part = np.searchsorted(self.parts_s, start_s)
        return [[k for k, own in zip(known, part, strict=True) if own == one] for one in np.unique(part)]

    def regressions(self) -> Iterator[tuple[int, RecordingRegression]]:
        """Number and regression of every chunk that is long enough, times since the recording's start."""
        for number, chunk in enumerate(self.chunks):
            part = cut(self.recording, chunk)
            assert part.force_n is not None
            try:
                signals = Signals(part, part.force_n, self.like.signals.cutoff_hz, self.unusable[chunk])
            except ValueError:
                continue
            if np.count_nonzero(signals.rows) < 50:
                continue
            signals.moved_to(float(self.recording.time_s[0]))
            yield number, self.like.like(signals)

    def sums(self, fit: ModelFit) -> dict[int, Sums]:
        """Of every chunk, at the shapes of the fit."""
        return {number: _sums(regression, fit) for number, regression in self.regressions()}


def cut(recording: Recording, part: slice) -> Recording:
    """A part of a recording, with its stamps."""
    assert recording.force_n is not None
    return Recording(
        recording.name, recording.time_s[part], recording.position_m[part], recording.force_n[part],
        recording.source,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A fit to all chunks and the sums that it rests on."""

    fit: ModelFit
    sums: dict[int, Sums]

    def rms_n(self) -> dict[int, float]:
        """What is left of each chunk, in N."""
        theta = self.fit.coefficients
        return {k: float(np.sqrt(s.plain_error(theta) / s.plain_rows)) for k, s in self.sums.items()}

    @property
    def force_n(self) -> float:
        """Standard deviation of the force in N, of a fit that has a bias: its column is one in the band."""
        rows = sum(s.plain_rows for s in self.sums.values())
        at = self.fit.owners.index("bias")
        mean = sum(float(s.plain_moment[at]) for s in self.sums.values()) / rows
        square = sum(s.plain_square for s in self.sums.values()) / rows
        return float(np.sqrt(max(square - mean**2, 0.0)))

    def total_rms_n(self) -> float:
        """What is left of all chunks together, in N."""
        theta, rows = self.fit.coefficients, sum(s.plain_rows for s in self.sums.values())
        return float(np.sqrt(sum(s.plain_error(theta) for s in self.sums.values()) / rows))

    def held_out(self, blocks: Sequence[Sequence[int]]) -> tuple[Floats, Floats]:
        """Sum of squared errors and rows of each block of chunks, predicted by the fit to all others."""
        errors, rows = [], []
        for block in blocks:
            theta = self._without(set(block))
            errors.append(sum(self.sums[k].plain_error(theta) for k in block))
            rows.append(sum(self.sums[k].plain_rows for k in block))
        return np.array(errors), np.array(rows, dtype=np.float64)

    def intervals(self, start_s: float, sense: float) -> dict[str, dict[str, Interval]]:
        """95 % intervals of the parameters by name, see `parameters.intervals`."""
        gram = np.sum([s.gram for s in self.sums.values()], axis=0)
        scale = np.sqrt(np.diag(gram))
        scale[scale == 0.0] = 1.0
        unit = gram / np.outer(scale, scale)
        unit[np.diag_indices_from(unit)] += 1e-10
        variance = self.fit.rss / max(1, self.fit.n - len(scale))
        return intervals_by(self.fit, np.linalg.inv(unit) * variance / np.outer(scale, scale), start_s, sense)

    def _without(self, block: set[int]) -> Floats:
        """Coefficients of the fit to the chunks outside a block; what shows in the block only is kept."""
        count = len(self.fit.coefficients)
        gram = np.sum([s.gram for s in self.sums.values()], axis=0)[:count, :count]
        rest = [s for k, s in self.sums.items() if k not in block]
        inner = np.sum([s.gram for s in rest], axis=0)[:count, :count]
        moment = np.sum([s.moment for s in rest], axis=0)[:count]
        known = np.diag(inner) > _SEEN * np.diag(gram)
        theta = self.fit.coefficients.copy()
        right = moment - inner[:, ~known] @ theta[~known]
        theta[known] = _solve(inner[np.ix_(known, known)], right[known])
        return theta


def fitted(whole: Whole, fit: ModelFit, steps: int = 2) -> Fitted:
    """The fit to all chunks: coefficients, and up to `steps` Gauss-Newton steps of the shapes that help."""
    best = _at(fit, whole.sums(fit))
    for _ in range(steps if any(fit.model.values()) else 0):
        stepped = _stepped(best)
        trial = _at(stepped, whole.sums(stepped))
        if trial.fit.rss >= best.fit.rss:
            break
        best = trial
    return best


def gain_of(whole: Whole, before: Fitted, after: Fitted) -> RmsGain:
    """Held-out gain with its interval by drawing blocks of chunks."""
    blocks = whole.blocks(before.sums)
    (first, rows), (second, _) = before.held_out(blocks), after.held_out(blocks)
    drawn = np.random.default_rng(0).integers(len(rows), size=(_DRAWS, len(rows)))
    ratios = 1.0 - np.sqrt(second[drawn].sum(axis=1) / np.maximum(first[drawn].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, (0.025, 0.975))
    sizes = [float(np.sqrt(np.sum(e) / np.sum(rows))) for e in (first, second)]
    return RmsGain(sizes[0], sizes[1], 1.0 - sizes[1] / max(sizes[0], 1e-300), float(low), float(high))


def _sums(regression: RecordingRegression, fit: ModelFit) -> Sums:
    jacobian, y = jacobian_of(regression, fit), regression.target
    plain = plain_columns(regression, fit)[regression.rows]
    force = regression.signals.force[regression.rows]
    return Sums(
        jacobian.T @ jacobian, jacobian.T @ y, float(y @ y), len(y),
        plain.T @ plain, plain.T @ force, float(force @ force), len(force),
    )  # fmt: skip


def _at(fit: ModelFit, sums: dict[int, Sums]) -> Fitted:
    """Coefficients and what they leave, at the shapes that the sums were made for."""
    count = len(fit.owners)
    gram = np.sum([s.gram for s in sums.values()], axis=0)[:count, :count]
    moment = np.sum([s.moment for s in sums.values()], axis=0)[:count]
    square, n = sum(s.square for s in sums.values()), sum(s.rows for s in sums.values())
    theta = _solve(gram, moment)
    rss = max(square - 2.0 * float(theta @ moment) + float(theta @ gram @ theta), 1e-300)
    return Fitted(replace(fit, coefficients=theta, rss=rss, n=n), sums)


def _stepped(at: Fitted) -> ModelFit:
    """One Gauss-Newton step of coefficients and shapes together, no shape by more than a fifth."""
    fit, count = at.fit, len(at.fit.owners)
    gram = np.sum([s.gram for s in at.sums.values()], axis=0)
    moment = np.sum([s.moment for s in at.sums.values()], axis=0)
    step = _solve(gram, moment - gram[:, :count] @ fit.coefficients)
    model: dict[str, Shape] = {}
    place = count
    for name, shape in fit.model.items():
        moves = step[place : place + len(shape)]
        model[name] = tuple(
            float(value + np.clip(move, -_FARTHEST * abs(value), _FARTHEST * abs(value)))
            for value, move in zip(shape, moves, strict=True)
        )
        place += len(shape)
    return replace(fit, model=model, coefficients=fit.coefficients + step[:count])


def _solve(gram: Floats, moment: Floats) -> Floats:
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = 1.0
    unit = gram / np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] += 1e-12
    return np.asarray(np.linalg.solve(unit, moment / scale) / scale)
