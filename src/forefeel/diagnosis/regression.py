"""Variable projection: for given shape parameters the force is linear in the rest, which is solved for.

Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973. A model is a mapping from the names of its causes to
their shape parameters; mass, damping and stiffness always take part.
"""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from forefeel.common.causes.base import ContactEffect, Site
from forefeel.common.causes.candidate import (
    Alignment,
    Candidate,
    Changing,
    Form,
    Mode,
    Model,
    Modulation,
    Periodic,
    ReadingColumns,
    Shape,
    Spectrum,
    Transmission,
    base_name,
)
from forefeel.common.causes.catalogue import CANDIDATES, cause_class
from forefeel.common.causes.column import OfColumn
from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import MotionGrid
from forefeel.common.causes.numerics import intervals_s
from forefeel.common.causes.periodic import Rhythm
from forefeel.common.causes.transmission import Backlash
from forefeel.common.causes.unmodelled_resonance import HIGHEST_MODE, MOST_DAMPED, UnmodelledResonance
from forefeel.common.error_size import Floats
from forefeel.diagnosis.noise import Noise, white
from forefeel.diagnosis.plain_regressions import look
from forefeel.diagnosis.signals import Mask, Signals, extent_of
from forefeel.diagnosis.verdict import Look

_DEPENDENT = 1e-7
_DEPENDENT_NORMAL = 1e-6  # inner products hold half of the digits


def solve(design: Floats, target: Floats) -> tuple[Floats, float]:
    """Least squares: (coefficients, residual sum of squares); what depends on earlier columns gets zero."""
    scale = np.sqrt(np.einsum("ij,ij->j", design, design))
    scale[scale == 0.0] = 1.0
    q, r = np.linalg.qr(design / scale)
    diagonal = np.abs(np.diag(r))
    free = diagonal > _DEPENDENT
    if not free.all():
        inner, rss = solve(design[:, free], target)
        coefficients = np.zeros(design.shape[1])
        coefficients[free] = inner
        return coefficients, rss
    along = q.T @ target
    rest = target - q @ along
    return np.linalg.solve(r, along) / scale, float(rest @ rest)


def _scale(gram: Floats) -> Floats:
    """Sizes of the columns of a Gram matrix, 1 of one that is zero."""
    sizes = np.sqrt(gram.diagonal())
    sizes[sizes == 0.0] = 1.0
    return sizes


def solve_normal(gram: Floats, moment: Floats) -> tuple[Floats, float]:
    """Solves normal equations: (coefficients, explained sum of squares); a dependent column gets 0."""
    if not len(moment):
        return np.empty(0), 0.0
    scale = _scale(gram)
    factor, stopped = dpotrf(gram / (scale[:, None] * scale), lower=1)
    diagonal = factor.diagonal()[: stopped - 1] if stopped else factor.diagonal()
    if stopped or min(diagonal.tolist()) < _DEPENDENT_NORMAL:
        free = np.ones(len(moment), dtype=np.bool_)
        weak = np.flatnonzero(diagonal < _DEPENDENT_NORMAL)
        free[weak[0] if len(weak) else stopped - 1] = False
        inner, explained = solve_normal(gram[np.ix_(free, free)], moment[free])
        coefficients = np.zeros(len(moment))
        coefficients[free] = inner
        return coefficients, explained
    scaled = moment / scale
    coefficients, _ = dpotrs(factor, scaled, lower=1)
    return coefficients / scale, float(scaled @ coefficients)


def solve_passive(gram: Floats, moment: Floats, sense: float, first: int) -> tuple[Floats, float]:
    """Solves normal equations in which each of the first `first` coefficients has the sign of `sense` or is
    zero; (coefficients, explained sum of squares).
    """
    best, explained = solve_normal(gram, moment)
    wrong = best[:first] * sense < 0.0
    if not wrong.any():
        return best, explained
    # leaving those out is best if none of them would gain by the sense that it may have: it is convex
    places = np.append(np.flatnonzero(~wrong), np.arange(first, len(moment)))
    inner, trial = solve_normal(gram[places[:, None], places], moment[places])
    best = np.zeros(len(moment))
    best[places] = inner
    gained = (moment[:first] - gram[:first] @ best)[wrong] * sense
    if not (best[:first] * sense < 0.0).any() and (gained <= 0.0).all():
        return best, trial
    # two that a sine does not tell apart, as mass and stiffness, are large and of both signs
    explained = -np.inf
    for used in product((True, False), repeat=first):
        free = np.ones(len(moment), dtype=np.bool_)
        free[:first] = used
        inner, trial = solve_normal(gram[np.ix_(free, free)], moment[free])
        if trial > explained and not (inner[: sum(used)] * sense < 0.0).any():
            best, explained = np.zeros(len(moment)), trial
            best[free] = inner
    return best, explained


BASE = ("mass_kg", "damping_n_s_m", "stiffness_n_m")
_BLOCK_BYTES, _SPECTRA_BYTES = 1.5e8, 1e8
_WHITE = 2  # taps of no colour
_FROM_THE_STAGE: tuple[Site, ...] = "sensor", "shaft"  # sites that a mass before the contact may have
C = TypeVar("C", bound=Changing)
Frame = tuple[tuple[str, Shape], ...]
_LEAST_SIDE = 0.03  # of the samples, on each side of a play
_NEAR_ZERO = 0.1  # of the range of the force, by which its zero may be off: where it is small
_MOST_PRODUCTS = 100_000
_SLACK = 1.0  # of a score, for coefficients that are left out because they depend on others
# of the target's power: less can not, or not well, be told by inner products
_CANCELLED, _UNSURE = 1e-9, 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ModelFit:
    """A model's linear parameters and what it leaves.

    `rss` is that of the whitened residual over `n` rows, in units of the noise's innovation; `owners` names
    the cause of each coefficient ("" for mass, damping, stiffness).
    """

    model: Model
    coefficients: Floats
    owners: tuple[str, ...]
    rss: float
    n: int
    penalty: float
    feasible: bool

    @property
    def score(self) -> float:
        """-2 log likelihood and penalty; less is better."""
        return self.n * float(np.log(self.rss / self.n)) + self.penalty

    def of(self, name: str) -> Floats:
        return self.coefficients[[i for i, owner in enumerate(self.owners) if owner == name]]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Whitened columns of one cause, their inner products with the target, and a number to know it by."""

    columns: Floats
    moment: Floats
    number: int


class RecordingRegression:
    """Fits models to one conditioned recording.

    Attributes:
        signals, extent: what is fitted.
        noise, coloured: by which residuals are whitened, and whether it was learned; assign with `whiten_by`.
        look: what plain regressions see; by default of these signals.
        sense: +1 when a positive force resists, -1 when the recording shows the reaction.
        parts_s: of several recordings as one, when each but the first begins, in s since the start.
    """

    def __init__(
        self,
        signals: Signals,
        speed_band: float,
        parts_s: tuple[float, ...] = (),
        look_result: Look | None = None,
    ) -> None:
        self.signals, self.parts_s = signals, parts_s
        self.extent = extent_of(signals, speed_band)
        s, self._motion = signals, motion_grid(signals, speed_band)
        self._motions: OrderedDict[object, MotionGrid] = OrderedDict()
        self._spectra: OrderedDict[object, Spectrum] = OrderedDict()
        self._whitened: OrderedDict[object, Block] = OrderedDict()
        self._made = 0
        self._aligning: tuple[object, Spectrum | None] = (), None
        self._most_blocks, self._most_spectra = (
            int(np.clip(most / (16.0 * len(s.t)), 16, 4000)) for most in (_BLOCK_BYTES, _SPECTRA_BYTES)
        )
        self._base = np.stack([s.linear_spectrum(d) for d in (2, 1, 0)])
        self.look = look(s, self._motion) if look_result is None else look_result
        self.sense = self.look.sense
        self._motion = replace(self._motion, force=self.sense * self._motion.force)
        low_n, high_n = sorted((self.sense * self.extent.low_n, self.sense * self.extent.high_n))
        self.extent = replace(self.extent, low_n=low_n, high_n=high_n)
        self.whiten_by(white())

    def like(self, signals: Signals, fit: ModelFit | None = None) -> "RecordingRegression":
        """Regression of the same bench along another motion, with this one's band, noise, extent and look.
        A further column of this one that `signals` lack is zero.

        `fit`: its damper, spring and constants make the force that columns may depend on, in place of the
        recorded one.
        """
        other = RecordingRegression(signals, self.extent.speed_band, look_result=self.look)
        other.extent = self.extent
        of, nowhere = other._motion.further, np.zeros_like(other._motion.x)
        beside = {column.name: of.get(column.name, nowhere) for column in self.extent.further}
        other._motion = replace(other._motion, further=beside)
        if fit is not None:
            m, (_, damping, stiffness) = other._motion, self.sense * fit.coefficients[: len(BASE)]
            constant = (n for n in fit.model if n == "bias" or CANDIDATES[n].coefficients == ("preload_n",))
            level_n = self.sense * sum(float(fit.of(name)[0]) for name in constant)
            other._motion = replace(m, force=damping * m.v + stiffness * m.x + level_n)
        other.whiten_by(self.noise)
        return other

    def whiten_by(self, noise: Noise) -> None:
        """Sets the noise by which residuals are whitened, and with it `coloured`, `rows` that count and the
        whitened `target`; forgets all fits, whitened columns and inner products.
        """
        self.noise = noise
        self.coloured = len(noise.taps) > _WHITE
        pieces = self.signals.piecewise(fine=False)
        self.rows: Mask = noise.rows(self.signals.rows, pieces)
        self._pieces = pieces
        self._counted = _as_slice(self.rows)
        self._whitener = noise.response(self.signals.phase)
        self.target = self._white(self.signals.force[:, None])[:, 0]
        self._power = float(self.target @ self.target)
        self._whitened.clear()
        self._products: dict[tuple[int, int], Floats] = {}
        self._fits: dict[tuple[tuple[str, Shape], ...], ModelFit] = {}

    def fit(self, model: Model) -> ModelFit:
        """Least-squares fit, whitened, at the model's shapes: mass and damping have the force's sense or are
        0; stiffness, too, unless `look` sees that it pushes away. Causes of a wrong sign only make it not
        `feasible`. Fits, columns and inner products are remembered.
        """
        key = tuple(model.items())
        if key not in self._fits:
            self._fits[key] = self._solve_model(model)
        return self._fits[key]

    def _solve_model(self, model: Model) -> ModelFit:
        """Computes the least-squares fit that `fit` caches: by inner products of the whitened columns, or by
        the columns themselves where the residual is so small that the products cancel.
        """
        blocks = self._blocks(model)
        named = zip(["", *model], blocks, strict=True)
        owners = tuple(name for name, block in named for _ in range(block.columns.shape[1]))
        gram, moment = self._normal(blocks)
        coefficients, explained = solve_passive(gram, moment, self.sense, len(BASE) - self.look.pushes_away)
        rss = self._power - explained
        if rss < _CANCELLED * self._power:
            used = coefficients != 0.0
            coefficients[used], rss = solve(self.design(model)[:, used], self.target)
        n = len(self.target)
        penalty, feasible = penalty_of(owners, model, n), self._feasible(model, owners, coefficients)
        return ModelFit(model, coefficients, owners, max(rss, 1e-300), n, penalty, feasible)

    def lowest_scores(self, model: Model, tried: Mapping[str, Sequence[Shape]]) -> dict[str, Floats]:
        """Lower bounds, by cause and shape, of the scores of the model with one of these causes more: those
        with coefficients of any sign allowed. -inf where none is known: the cause changes the columns of
        others, or next to nothing is left.
        """
        known, moved, n = self._blocks(model), frame(model, Changing), len(self.target)
        gram, moment = self._normal(known)
        scale = _scale(gram)
        powers, directions = np.linalg.eigh(gram / np.outer(scale, scale))
        used = powers > _DEPENDENT_NORMAL**2
        directions = directions[:, used] / np.sqrt(powers[used]) / scale[:, None]
        explained = directions.T @ moment
        bounds = {name: np.full(len(shapes), -np.inf) for name, shapes in tried.items()}
        for name, shapes in tried.items():
            if isinstance(CANDIDATES[name], Changing) or not shapes:
                continue
            new = [self._white_block(model, moved, name, shape) for shape in shapes]
            across = np.array([directions.T @ np.vstack([self._product(a, b) for a in known]) for b in new])
            inner = np.array([self._product(b, b) for b in new]) - np.swapaxes(across, 1, 2) @ across
            along = np.array([block.moment for block in new]) - explained @ across
            gained = np.einsum("si,sij,sj->s", along, np.linalg.pinv(inner, 1e-9, hermitian=True), along)
            left = self._power - float(explained @ explained) - gained
            owners = ("",) * (len(moment) + new[0].columns.shape[1])
            penalty = [penalty_of(owners, {**model, name: shape}, n) for shape in shapes]
            scores = n * np.log(np.maximum(left, 1e-300) / n) + penalty - _SLACK
            bounds[name] = np.where(left < _UNSURE * self._power, -np.inf, scores)
        return bounds

    def design(self, model: Model) -> Floats:
        """Whitened columns of a model at the rows that count, shape (rows, coefficients)."""
        return np.hstack([block.columns for block in self._blocks(model)])

    def no_peak(self, model: Model) -> bool:
        """True if a mode in the model is too damped, or too near the end of the band, to show a peak."""
        highest = HIGHEST_MODE * self.signals.cutoff_hz
        modes = [s for n, s in model.items() if base_name(n) == UnmodelledResonance.name]
        return any(s[0] > highest or s[1] > MOST_DAMPED for s in modes)

    def _normal(self, blocks: Sequence["Block"]) -> tuple[Floats, Floats]:
        """Gram matrix of the blocks side by side and their inner products with the target."""
        moment = np.concatenate([block.moment for block in blocks])
        ends = np.cumsum([len(block.moment) for block in blocks])
        places = [slice(end - len(block.moment), end) for end, block in zip(ends, blocks, strict=True)]
        gram = np.empty((len(moment), len(moment)))
        for i, a in enumerate(blocks):
            for j in range(i + 1):
                product = self._product(a, blocks[j])
                gram[places[i], places[j]] = product
                gram[places[j], places[i]] = product.T
        return gram, moment

    def _product(self, a: "Block", b: "Block") -> Floats:
        """Inner products of two blocks' columns, computed once."""
        product = self._products.get((a.number, b.number))
        if product is None:
            if len(self._products) > _MOST_PRODUCTS:
                self._products.clear()
            product = a.columns.T @ b.columns
            self._products[a.number, b.number], self._products[b.number, a.number] = product, product.T
        return product

    def block(self, model: Model, name: str, shape: Shape) -> Floats:
        """Columns of one cause ("": mass, damping, stiffness) within a model, on the coarse grid, filtered,
        not whitened; times the coefficients they are N. Shape (samples, coefficients), which may be none.
        """
        candidate = CANDIDATES.get(name)
        if isinstance(candidate, Periodic):
            return candidate.columns(self.signals.t, shape)
        if _has_no_column(candidate):
            return np.empty((len(self.signals.t), 0))
        return self.signals.column(self._aligned(model, name, shape, candidate)).T

    def _aligned(self, model: Model, name: str, shape: Shape, candidate: Candidate | None) -> Spectrum:
        """Spectra of a cause's columns as the load cell shows them."""
        spectra = self._columns(model, name, shape, candidate)
        factor = None if isinstance(candidate, ReadingColumns) else self._alignment(model)
        return spectra if factor is None else spectra * factor

    def _alignment(self, model: Model) -> Spectrum | None:
        """`alignment` of a model; only the last one is kept."""
        key = frame(model, Alignment)
        if self._aligning[0] != key:
            self._aligning = key, alignment(self.signals.omega, model)
        return self._aligning[1]

    def predicted(self, fit: ModelFit, leave: str | None = None) -> Floats:
        """Force of the fit in N, coarse grid, without the cause `leave` ("": mass, damper and spring)."""
        total = np.zeros(len(self.signals.t))
        for name, shape in [("", ()), *fit.model.items()]:
            block = self.block(fit.model, name, shape)
            if block.shape[1] and name != leave:
                total += block @ fit.of(name)
        return total

    def force_of(self, model: ContactModel) -> Floats:
        """Force of another model, whose positive resists, along the recorded motion, on the coarse grid."""
        force_n = forces_along(model, self._motion, self.signals.origin_s)
        return self.sense * self.signals.column(self.signals.spectrum(force_n))

    def residual(self, fit: ModelFit) -> Floats:
        """Force less the model's, on the coarse grid."""
        return np.asarray(self.signals.force - self.predicted(fit))

    def rounding_n(self, mass: float, damping: float, stiffness: float) -> float:
        """rms in N of the force that mass, damper and spring in SI units make of the encoder's steps, whose
        power `step^2 / 12` is white up to half of the sampling rate, in the motion's band.
        """
        s = self.signals
        reach_hz = min(s.motion_reach_hz, s.cutoff_hz)
        w = 2.0 * np.pi * np.linspace(0.0, reach_hz, 200)
        gain = np.mean(np.abs(stiffness - w * w * mass + 1j * w * damping) ** 2)
        return s.step_m * float(np.sqrt(gain * min(1.0, 2.0 * reach_hz / s.even_hz) / 12.0))

    def column_of(self, name: str) -> str:
        """The further column that a form follows, "" for others."""
        candidate = CANDIDATES[name]
        return self.extent.further[candidate.slot].name if isinstance(candidate, OfColumn) else ""

    def motion(self, model: Model) -> MotionGrid:
        """Motion on the fine grid as the wall sees it, behind the model's plays and contacts; the stage's
        own, the same object, where it has none. The last 8 are kept.
        """
        key = frame(model, Transmission)
        if key not in self._motions:
            motion = self._motion
            for transmission, shape in changing(model, Transmission):
                motion = transmission.moved(motion, shape)
            _keep(self._motions, key, motion, 8)
        return self._motions[key]

    def _blocks(self, model: Model) -> list["Block"]:
        moved = frame(model, Changing)
        return [self._white_block(model, moved, *cause) for cause in [("", ()), *model.items()]]

    def _white_block(self, model: Model, moved: Frame, name: str, shape: Shape) -> "Block":
        """Whitened columns of a cause and their products with the target, from the cache or made anew;
        `moved`: the model's causes that change the columns of all others, part of the key.
        """
        key = (() if isinstance(CANDIDATES.get(name), ReadingColumns) else moved), name, shape
        if key not in self._whitened:
            columns = self._white_columns(model, name, shape)
            self._made += 1
            _keep(self._whitened, key, Block(columns, columns.T @ self.target, self._made), self._most_blocks)
        else:
            self._whitened.move_to_end(key)
        return self._whitened[key]

    def _white_columns(self, model: Model, name: str, shape: Shape) -> Floats:
        """Whitened columns of a cause at the rows that count, shape (rows, coefficients)."""
        candidate = CANDIDATES.get(name)
        if isinstance(candidate, Periodic):
            return self._white(self.block(model, name, shape))
        if _has_no_column(candidate):
            return np.empty((len(self.target), 0))
        spectra = self._aligned(model, name, shape, candidate)
        # whitened in the spectrum: what wraps around falls on rows that do not count
        return self.signals.column(spectra * self._whitener)[:, self._counted].T

    def slopes_of_course(self, fit: ModelFit, name: str) -> Floats:
        """Whitened derivatives of the force by each rate of a rhythm, at the rows that count."""
        motion, factor, rhythm = self.motion(fit.model), self._alignment(fit.model), CANDIDATES[name]
        assert isinstance(rhythm, Rhythm)
        slopes = rhythm.slopes(motion, fit.model[name], fit.of(name)) * motion.touching
        spectra = self.signals.spectrum(slopes) * self._whitener
        return self.signals.column(spectra if factor is None else spectra * factor)[:, self._counted].T

    def _white(self, columns: Floats) -> Floats:
        return self.noise.whiten(columns, self._pieces)[self.rows] / self.noise.innovation_n

    def _columns(self, model: Model, name: str, shape: Shape, candidate: Candidate | None) -> Spectrum:
        """Spectra of a cause's columns (`candidate` None: mass, damping, stiffness), before late stamps, a
        slow cell or a weak fixture act on them; from the cache or made anew.
        """
        moved = frame(model, Transmission, Modulation)
        if candidate is None and not moved:
            return self._base
        key = (moved, name, shape)
        if key not in self._spectra:
            _keep(self._spectra, key, self._computed(model, shape, candidate), self._most_spectra)
        return self._spectra[key]

    def _computed(self, model: Model, shape: Shape, candidate: Candidate | None) -> Spectrum:
        """Spectra of the columns of `candidate` (None: mass, damping, stiffness) along the model's motion,
        times the model's modulations; these spare modes, columns of time, and a mass at the sensor.
        """
        motion = self.motion(model)
        if isinstance(candidate, Mode):
            moved = motion is not self._motion
            driven = self.signals.spectrum(motion.a * motion.touching) if moved else self._base[0]
            return np.stack(candidate.spectra(self.signals.omega, driven, shape))
        if isinstance(candidate, ReadingColumns):
            return self.signals.spectrum(candidate.columns(motion.t, shape).T)
        if candidate is None:
            at = {"sensor": self._motion.a, "shaft": motion.a, "wall": motion.a * motion.touching}
            gripped = 1.0 if drags(model) else motion.touching
            columns = [at[mass_site(model)], motion.v * gripped, motion.x]
        elif isinstance(candidate, Transmission | Modulation):
            columns = candidate.columns(motion, shape)
        else:
            assert isinstance(candidate, Form)
            columns = candidate.columns(motion, shape)
            if candidate.at_wall:
                columns = [column * motion.touching for column in columns]
        for modulation, wrap in changing(model, Modulation):
            factor = modulation.factor(motion, wrap)
            carried = candidate is None and mass_site(model) == "sensor"  # the mass, which is before it
            columns = [columns[0] if carried else factor * columns[0], *(factor * c for c in columns[1:])]
        return self.signals.spectrum(np.stack(columns))

    def _feasible(self, model: Model, owners: tuple[str, ...], coefficients: Floats) -> bool:
        """True if every mode can show a peak, the causes' coefficients have the signs that their candidates
        say, the motion makes every form happen (`Form.happens`), every play is used on both sides, and zeros
        of the tip's force are near the cell's offset.
        """
        if self.no_peak(model):
            return False
        signs = [sign for name in model for sign in CANDIDATES[name].signs]
        if any(np.multiply(signs, self.sense * coefficients[len(BASE) :]) < 0.0):
            return False
        forms = [(form, shape) for name, shape in model.items() if isinstance(form := CANDIDATES[name], Form)]
        if not all(form.happens(self.motion(model), shape) for form, shape in forms):
            return False
        return self._plays_on_both_sides(model) and self._zero_is_offset(model, owners, coefficients)

    def _zero_is_offset(self, model: Model, owners: tuple[str, ...], coefficients: Floats) -> bool:
        """True if every factor takes the tip's force to be zero near the cell's offset."""
        offset_n = self.sense * float(coefficients[owners.index("bias")]) if "bias" in owners else 0.0
        near_n = _NEAR_ZERO * (self.extent.high_n - self.extent.low_n)
        zeros_n = (shape[-1] for modulation, shape in changing(model, Modulation) if modulation.by_tip)
        return all(abs(zero_n - offset_n) < near_n for zero_n in zeros_n)

    def _plays_on_both_sides(self, model: Model) -> bool:
        """True if the instrument lies against both sides of every play for a while; if not, it is a wall."""
        for name, shape in model.items():
            if issubclass(cause_class(name), Backlash):
                behind = self.motion({name: shape}).x - self._motion.x
                shares = [float(np.mean(side * behind > 0.49 * shape[0])) for side in (1.0, -1.0)]
                if min(shares) < _LEAST_SIDE:
                    return False
        return True


def motion_grid(s: Signals, speed_band: float) -> MotionGrid:
    """Collects the motion of conditioned signals on their fine grid, in contact throughout; the force is
    interpolated to it from the coarse grid, piece by piece. `speed_band`: speed in m/s below which a
    direction is noise; stored.
    """
    grids = zip(s.piecewise(), s.piecewise(fine=False), strict=True)
    return MotionGrid(
        s.fine_t, s.fine_x, s.fine_v, s.fine_a,
        np.concatenate([intervals_s(s.fine_t[p]) for p in s.piecewise()]), tuple(s.piecewise()),
        further=s.fine_further, touching=np.ones_like(s.fine_t), speed_band=speed_band, decimated=s.decimated,
        force=np.concatenate([np.interp(s.fine_t[f], s.t[c], s.force[c]) for f, c in grids]),
    )  # fmt: skip


def forces_along(model: ContactModel, motion: MotionGrid, start_s: float) -> Floats:
    """Force of a model along a motion that begins at the stamp `start_s`; each piece is a new contact."""
    timed = replace(motion, t=motion.t + start_s)
    return np.concatenate([model.runtime().forces_n(timed[piece]) for piece in motion.pieces])


def _has_no_column(candidate: Candidate | None) -> bool:
    return isinstance(candidate, Changing) and not candidate.coefficients


def frame(model: Model, *kinds: type[Changing]) -> Frame:
    """Causes of these kinds, which change the columns of all others, with shapes; sorted to be a key."""
    return tuple(sorted((n, shape) for n, shape in model.items() if isinstance(CANDIDATES[n], kinds)))


def changing(model: Model, kind: type[C]) -> list[tuple[C, Shape]]:
    """Candidates of one kind with their shapes, in the order of `frame`, but a contact after what moves."""
    pairs = [(CANDIDATES[name], shape) for name, shape in frame(model, kind)]
    pairs.sort(key=lambda pair: issubclass(pair[0].kind, ContactEffect))
    return [(candidate, shape) for candidate, shape in pairs if isinstance(candidate, kind)]


def mass_site(model: Model) -> Site:
    """Site whose motion the mass makes: one before the contact if a cause puts it there, else the wall."""
    sites = {candidate.mass_site for candidate, _ in changing(model, Changing)}
    return next((site for site in _FROM_THE_STAGE if site in sites), "wall")


def drags(model: Model) -> bool:
    """True if a cause puts the damper along the shaft, where it acts without contact, too."""
    return any(candidate.drags for candidate, _ in changing(model, Changing))


def alignment(omega: Floats, model: Model) -> Spectrum | None:
    """Product of the transfers of late stamps, a slow cell, a weak fixture; None if the model has none."""
    factor: Spectrum | None = None
    for candidate, shape in changing(model, Alignment):
        transfer = candidate.factor(omega, shape)
        factor = transfer if factor is None else factor * transfer
    return factor


def penalty_of(owners: tuple[str, ...], model: Model, n: int) -> float:
    """Penalty of a score: the Bayesian information criterion, in which a shape counts as two linear
    parameters, and the price of the forms.
    """
    price = n * sum(CANDIDATES[name].price for name in model)
    return price + float(np.log(n)) * (len(owners) + 2.0 * sum(len(shape) for shape in model.values()))


def _as_slice(rows: Mask) -> Mask | slice:
    """Rows as a slice where they are in one run, which indexes much faster; else as they are."""
    index = np.flatnonzero(rows)
    whole = len(index) and index[-1] - index[0] + 1 == len(index)
    return slice(int(index[0]), int(index[-1]) + 1) if whole else rows


def _keep(cache: OrderedDict, key: object, value: object, most: int) -> None:  # type: ignore[type-arg]
    cache[key] = value
    while len(cache) > most:
        cache.popitem(last=False)
