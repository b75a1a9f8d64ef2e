"""Variable projection: for given shape parameters the force is linear in the rest, which is solved for.

Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973. A model is a mapping from the names of its causes to
their
shape parameters; mass, damping and stiffness always take part.
"""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from common.error_size import Floats
from diagnosis.diagnose.candidates import (
    CANDIDATES,
    MOST_DAMPED,
    Candidate,
    Extent,
    Motion,
    Shape,
    play,
    touch,
)
from diagnosis.diagnose.noise import Noise, white
from diagnosis.diagnose.signals import Mask, Signals, Spectrum

Model = Mapping[str, Shape]

BASE = ("mass_kg", "damping_n_s_m", "stiffness_n_m")
_KEPT, _KEPT_SAMPLES = 400, 2e6
_DEPENDENT = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A model's linear parameters and what it leaves.

    `rss` is that of the whitened residual over `n` rows, in units of the noise's innovation; `owners` names
    the
    cause of each coefficient ("" for mass, damping, stiffness).
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
        """The coefficients of one cause."""
        return self.coefficients[[i for i, owner in enumerate(self.owners) if owner == name]]


class Regression:
    """Fits models to one conditioned recording.

    Attributes:
        signals, extent: what is fitted.
        noise: by which residuals are whitened; assign with `whiten_by`.
        sense: +1 when a positive force resists, -1 when the recording shows the reaction.
    """

    def __init__(self, signals: Signals, speed_band: float) -> None:
        self.signals = signals
        self.extent = Extent.of(signals, speed_band)
        s = signals
        self._kept = int(np.clip(_KEPT_SAMPLES / len(s.t), 16, _KEPT))
        self._motion = Motion(
            s.fine_t, s.fine_x, s.fine_v, s.fine_a, np.ones_like(s.fine_t), tuple(s.piecewise()), speed_band
        )
        self._motions: OrderedDict[object, Motion] = OrderedDict()
        self._spectra: OrderedDict[object, list[Spectrum]] = OrderedDict()
        self._whitened: OrderedDict[object, Floats] = OrderedDict()
        self._base = [s.linear_spectrum(d) for d in (2, 1, 0)]
        v = s.column(self._base[1])
        self.sense = 1.0 if float(v[s.rows] @ (s.force - s.force[s.rows].mean())[s.rows]) >= 0.0 else -1.0
        self.whiten_by(white())

    def whiten_by(self, noise: Noise) -> None:
        """Residuals are weighed by this noise from now on."""
        self.noise = noise
        pieces = self.signals.piecewise(fine=False)
        self.rows: Mask = noise.rows(self.signals.rows, pieces)
        self._pieces = pieces
        self.target = self._white(self.signals.force[:, None])[:, 0]
        self._whitened.clear()

    def fit(self, model: Model) -> Fit:
        """Least squares at these shapes."""
        design, owners = self.design(model)
        coefficients, rss = solve(design, self.target)
        n = len(self.target)
        penalty = penalty_of(owners, model, n)
        return Fit(
            model,
            coefficients,
            owners,
            max(rss, 1e-300),
            n,
            penalty,
            self._feasible(model, owners, coefficients),
        )

    def design(self, model: Model) -> tuple[Floats, tuple[str, ...]]:
        """Whitened columns that count and the owner of each."""
        blocks = [self._white_block(model, name, shape) for name, shape in [("", ()), *model.items()]]
        owners = [
            name for name, block in zip(["", *model], blocks, strict=True) for _ in range(block.shape[1])
        ]
        return np.hstack(blocks), tuple(owners)

    def block(self, model: Model, name: str, shape: Shape) -> Floats:
        """Filtered columns in N of one cause within a model, on the coarse grid, not whitened."""
        candidate = CANDIDATES.get(name)
        if name == "pulsation":
            return harmonics(self.signals.t, shape[0])
        if candidate is not None and candidate.kind in ("motion", "contact", "alignment"):
            return np.empty((len(self.signals.t), 0))
        aligned = candidate is None or candidate.kind != "sensor"
        spectra = self._columns(model, name, shape, candidate)
        if aligned:
            factor = alignment(self.signals.omega, model)
            spectra = spectra if factor is None else [spectrum * factor for spectrum in spectra]
        return np.column_stack([self.signals.column(spectrum) for spectrum in spectra])

    def predicted(self, fit: Fit, leave: str | None = None) -> Floats:
        """The model's force on the coarse grid, without the share of the cause `leave`."""
        total = np.zeros(len(self.signals.t))
        for name, shape in [("", ()), *fit.model.items()]:
            block = self.block(fit.model, name, shape)
            if block.shape[1] and name != leave:
                total += block @ fit.of(name)
        return total

    def residual(self, fit: Fit) -> Floats:
        """Force less the model's, on the coarse grid."""
        return np.asarray(self.signals.force - self.predicted(fit))

    def motion(self, model: Model) -> Motion:
        """The motion that the wall sees in this model."""
        key = _frame(model, ("motion", "contact"))
        if key not in self._motions:
            motion = self._motion
            for name, shape in key:
                motion = play(motion, shape[0]) if name == "backlash" else touch(motion, shape[0])
            _keep(self._motions, key, motion, 8)
        return self._motions[key]

    def white_block(self, model: Model, name: str, shape: Shape) -> Floats:
        """As `block`, whitened, only the rows that count."""
        return self._white_block(model, name, shape)

    def _white_block(self, model: Model, name: str, shape: Shape) -> Floats:
        key = (_frame(model, ("motion", "contact", "alignment")), name, shape)
        if key not in self._whitened:
            _keep(self._whitened, key, self._white(self.block(model, name, shape)), self._kept)
        return self._whitened[key]

    def _white(self, columns: Floats) -> Floats:
        if not columns.shape[1]:
            return np.empty((int(np.count_nonzero(self.rows)), 0))
        return self.noise.whiten(columns, self._pieces)[self.rows] / self.noise.innovation_n

    def _columns(self, model: Model, name: str, shape: Shape, candidate: Candidate | None) -> list[Spectrum]:
        moved = _frame(model, ("motion", "contact"))
        if candidate is None and not moved:
            return self._base
        key = (moved, name, shape)
        if key not in self._spectra:
            _keep(self._spectra, key, self._fresh(model, shape, candidate), self._kept)
        return self._spectra[key]

    def _fresh(self, model: Model, shape: Shape, candidate: Candidate | None) -> list[Spectrum]:
        motion = self.motion(model)
        if candidate is None:
            carried = "contact_loss:carried" in model
            columns = [motion.a * (1.0 if carried else motion.touching), motion.v * motion.touching, motion.x]
        elif candidate.kind == "mode":
            driven = (
                self.signals.spectrum(motion.a * motion.touching)
                if motion is not self._motion
                else self._base[0]
            )
            return mode_spectra(self.signals.omega, driven, shape)
        else:
            assert candidate.columns is not None
            columns = candidate.columns(motion, shape)
            if candidate.at_wall:
                columns = [column * motion.touching for column in columns]
        return [self.signals.spectrum(column) for column in columns]

    def _feasible(self, model: Model, owners: tuple[str, ...], coefficients: Floats) -> bool:
        if any(n.startswith("unmodelled_resonance") and s[1] > MOST_DAMPED for n, s in model.items()):
            return False
        for name in dict.fromkeys(owners):
            if name:
                values = coefficients[[i for i, owner in enumerate(owners) if owner == name]]
                signs = CANDIDATES[name].signs
                if any(
                    sign and sign * self.sense * value < 0.0
                    for sign, value in zip(signs, values, strict=True)
                ):
                    return False
        return True


def penalty_of(owners: tuple[str, ...], model: Model, n: int) -> float:
    """Bayesian information criterion; a searched shape costs twice a linear parameter."""
    return float(np.log(n)) * (len(owners) + 2.0 * sum(len(shape) for shape in model.values()))


def solve(design: Floats, target: Floats) -> tuple[Floats, float]:
    """(coefficients, residual sum of squares); of dependent columns the later ones get zero."""
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


def harmonics(t: Floats, frequency_hz: float, count: int = 3) -> Floats:
    """sin and cos of the frequency and its multiples."""
    phase = 2.0 * np.pi * frequency_hz * t[:, None] * np.arange(1, count + 1)
    return np.hstack([np.sin(phase), np.cos(phase)])


def alignment(omega: Floats, model: Model) -> Spectrum | None:
    """What late stamps, a slow load cell and a weak fixture do to a spectrum; None when the model has
    none."""
    if not _frame(model, ("alignment",)):
        return None
    factor = np.ones(len(omega), dtype=np.complex128)
    if "time_delay" in model:
        factor *= np.exp(-1j * omega * model["time_delay"][0])
    if "sensor_lag" in model:
        factor /= 1.0 + 1j * omega * model["sensor_lag"][0]
    if "unmodelled_resonance:fixture" in model:
        frequency_hz, zeta = model["unmodelled_resonance:fixture"]
        w = 2.0 * np.pi * frequency_hz
        factor *= w * w / (w * w - omega**2 + 2j * zeta * w * omega)
    return factor


def mode_spectra(omega: Floats, driven: Spectrum, shape: Shape) -> list[Spectrum]:
    """A second mode `y'' + 2 zeta w y' + w^2 y = a`: its restoring force w^2 y and its rate w y'."""
    w, zeta = 2.0 * np.pi * shape[0], shape[1]
    y = driven / (w * w - omega**2 + 2j * zeta * w * omega)
    return [w * w * y, 1j * w * omega * y]


def _frame(model: Model, kinds: tuple[str, ...]) -> tuple[tuple[str, Shape], ...]:
    """What in a model changes the columns of all others; sorted, so that it can be a key."""
    return tuple(sorted((n, shape) for n, shape in model.items() if CANDIDATES[n].kind in kinds))


def _keep(cache: OrderedDict, key: object, value: object, most: int) -> None:  # type: ignore[type-arg]
    cache[key] = value
    while len(cache) > most:
        cache.popitem(last=False)
