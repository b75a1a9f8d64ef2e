"""A look before the search: which way the axis points, and how much of the force plain regressions explain.

Columns of the motion with coefficients that can only take energy (Lawson and Hanson's non-negative least
squares), judged on held-out blocks, in the band of the strokes and in the whole band: a slow force that has
nothing to do with the strokes decides neither. What is seen here steers and vetoes; it names nothing.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from forefeel.common.causes.candidate import Spectrum
from forefeel.common.causes.motion import MotionGrid, PrandtlElement, SettledLag
from forefeel.common.error_size import Floats
from forefeel.diagnosis.signals import Signals
from forefeel.diagnosis.verdict import Family, Look

FAMILIES: tuple[Family, ...] = "friction", "relaxation", "stiffening"
_PLAIN: tuple[tuple[str, ...], ...] = ("base",), ("base", "away")
"""Families of mass, damper and a spring that resists, and with one that pushes away, too."""
_BLOCKS = 8
_RIDGE = 1e-9
_SLOW = 0.05  # of the speed's power: half of the frequency below which it lies is slower than the strokes
_STEEP = 8  # power of the high-pass, fourth order forwards and backwards
_PRESLIDING = 0.01, 0.05, 0.2  # of the stroke
_RELAXING_S = 0.1, 1.0, 10.0
_LATE_S = 0.02, 0.06, 0.2
_HEAVIEST_KG = 1e3
"""On a bench: a mass that would have to be more is how a sine shows a spring of the other direction."""
_TRUSTED, _CLEAR = 0.3, 0.05  # explained in the band, and by how much one direction explains more
_MUCH_LESS = 0.7  # of what a spring that resists leaves: what one that pushes away then leaves
_SEEN = 0.25  # of what mass, damper and spring leave: a family that takes less is not seen


def look(signals: Signals, motion: MotionGrid) -> Look:
    """Judges by plain regressions, before the search: sense of the force (+1: resists, -1), shares of its
    variance explained on held-out blocks in the whole band and above `slow_hz`, and the family of causes that
    takes most of what mass, damper, spring leave (None: below a quarter). `motion`: of the stage, fine grid.
    """
    columns = _columns(signals, motion)
    slow_hz, gain = _high_pass(signals)
    whole, band = _Band(signals, columns, 1.0), _Band(signals, columns, gain)
    sense, away = _direction(band, whole)
    plain = _PLAIN[away]
    springs, best = [], -np.inf
    family: Family | None = None
    most = _SEEN
    for part in (whole, band):
        spring = part.explained(plain, sense)
        springs.append(spring)
        for name in FAMILIES:
            share = part.explained((*plain, name), sense)
            best, taken = max(best, share), 1.0 - (1.0 - share) / max(1.0 - spring, 1e-300)
            if taken > most:
                family, most = name, taken
        best = max(best, part.explained((*plain, *FAMILIES), sense))
    return Look(sense, slow_hz, springs[0], springs[1], best, family, away)


def _direction(band: "_Band", whole: "_Band") -> tuple[float, bool]:
    """(sense, True if the spring pushes away). The sense is that in which mass, damper, spring and friction
    explain more, in the band or, where that is not clear, in the whole band; the spring pushes away (a weight
    that stands upright, a magnet) if a fit that lets it leaves under 70 % of what a resisting spring, at once
    or late, leaves.
    """
    for part in (band, whole):
        resisting, late, either = (
            {sense: part.explained((*columns, "friction"), sense) for sense in (1.0, -1.0)}
            for columns in (("base",), ("base", "late"), ("base", "away"))
        )
        left = 1.0 - max(late.values())  # a late spring turns the work of a cycle, too
        away = 1.0 - max(either.values()) < _MUCH_LESS * left
        shares = either if away else resisting
        if max(shares.values()) >= _TRUSTED and abs(shares[1.0] - shares[-1.0]) >= _CLEAR:
            break
    return max(shares, key=lambda sense: shares[sense]), away


def strokes_in_band(
    signals: Signals, motion: MotionGrid, look: Look
) -> tuple[Floats, Floats, dict[str, Floats]]:
    """(position in m, measured force in N, force in N of each regression by its name), high-passed at
    `slow_hz`, at the rows that count; regressions of mass, damper, spring alone and with the family of `look`
    or all three.
    """
    columns, gain = _columns(signals, motion), _high_pass(signals)[1]
    band, family, sense = _Band(signals, columns, gain), look.family, look.sense
    beside = FAMILIES if family is None else (family,)
    plain = _PLAIN[look.pushes_away]
    families = {"mass, damper, spring": plain, f"with {family or 'all three'}": (*plain, *beside)}
    position = signals.column(signals.linear_spectrum(0) * gain)[signals.rows]
    return position, band.force, {name: band.predicted(used, sense) for name, used in families.items()}


class _Band:
    """Columns and force of the rows that count, through one more filter, cut into blocks; both without what
    goes with the further columns of the recording.
    """

    def __init__(self, signals: Signals, columns: dict[str, list[Spectrum]], gain: Floats | float) -> None:
        rows = signals.rows
        names = [name for name, spectra in columns.items() for _ in spectra]
        self._owners = np.array(names)
        table = np.column_stack(
            [signals.column(spectrum * gain)[rows] for spectra in columns.values() for spectrum in spectra]
        )
        force = signals.column(signals.force_spectrum() * gain)[rows]
        self.force = force - force.mean()
        table -= table.mean(axis=0)
        beside = _further_columns(signals, gain)[rows]
        known, _ = np.linalg.qr(beside - beside.mean(axis=0))
        self.force, table = (u - known @ (known.T @ u) for u in (self.force, table))
        self._table = table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300)
        self._blocks = np.array_split(np.arange(len(force)), _BLOCKS)

    def explained(self, families: Sequence[str], sense: float) -> float:
        """Share of the force's variance that `predicted` explains, on blocks that were held out."""
        return explained_share(self.force, self.predicted(families, sense))

    def predicted(self, families: Sequence[str], sense: float) -> Floats:
        """Force in N of a non-negative regression on the columns of these families, each of 8 blocks
        predicted by the fit to the others; `sense` -1: the force is turned for the fit, the result turned
        back.
        """
        table, force = self._table[:, np.isin(self._owners, families)], sense * self.force
        predicted = np.zeros(len(force))
        gram, moment = table.T @ table, table.T @ force
        ridge = _RIDGE * len(force) * np.eye(len(gram))
        for block in self._blocks:
            part = table[block]
            factor = np.linalg.cholesky(gram - part.T @ part + ridge)
            theta, _ = nnls(factor.T, np.linalg.solve(factor, moment - part.T @ force[block]))
            predicted[block] = sense * (part @ theta)
        return predicted


def explained_share(force: Floats, predicted: Floats) -> float:
    return 1.0 - float(np.mean((force - predicted) ** 2)) / max(float(np.mean(force**2)), 1e-300)


def _columns(signals: Signals, motion: MotionGrid) -> dict[str, list[Spectrum]]:
    """Spectra of the regressions' columns by family: "friction", "relaxation", "stiffening", "base" for mass,
    damper, spring, without the mass where 1000 kg would make less than the force, "away" for a spring below 0
    and "late" for one that answers later.
    """
    low, high = np.quantile(motion.x, (0.05, 0.95))
    depth = (motion.x - 0.5 * (low + high)) / max(high - low, 1e-300)
    steps = motion.rate * motion.dt / max(high - low, 1e-300)
    element = PrandtlElement().step
    dry = [motion.direction(), *(motion.through(element, steps / share) for share in _PRESLIDING)]
    base = [signals.linear_spectrum(derivative) for derivative in (2, 1, 0)]
    rows = signals.rows
    if _HEAVIEST_KG * np.std(signals.column(base[0])[rows]) < np.std(signals.force[rows]):
        del base[0]
    decays = (np.exp(-motion.dt / tau_s) for tau_s in _RELAXING_S)
    settled = (motion.through(SettledLag().step, motion.x, decay) for decay in decays)  # of Maxwell branches
    return {
        "base": base,
        "away": [-base[-1]],
        "late": [base[-1] * np.exp(-1j * signals.omega * late_s) for late_s in _LATE_S],
        "friction": [signals.spectrum(column) for column in dry],
        "relaxation": [signals.spectrum(motion.x - lagging) for lagging in settled],
        "stiffening": [signals.spectrum(sign * depth**power) for power in (2, 3) for sign in (1.0, -1.0)],
    }


def _further_columns(signals: Signals, gain: Floats | float) -> Floats:
    """The further columns on the coarse grid, with sine and cosine of an angle, and the directions in which
    they move, each times `gain` by frequency; shape (coarse samples, columns).
    """
    table: list[Floats] = []
    for name, c in signals.fine_further.items():
        table += [
            c,
            np.sign(np.gradient(c)),
            *([np.sin(c), np.cos(c)] if signals.units[name] == "rad" else []),
        ]
    if not table:
        return np.empty((len(signals.t), 0))
    return signals.column(signals.spectrum(np.array(table)) * gain).T


def _high_pass(signals: Signals) -> tuple[float, Floats]:
    """Corner in Hz, half of the frequency below which 5 % of the speed's power lies, and the high-pass's gain
    at each frequency of a spectrum.
    """
    frequency_hz = signals.omega / (2.0 * np.pi)
    order = np.argsort(frequency_hz, kind="stable")
    power = np.cumsum(np.abs(signals.linear_spectrum(1)[order]) ** 2)
    slow_hz = 0.5 * float(frequency_hz[order][np.searchsorted(power, _SLOW * power[-1])])
    with np.errstate(divide="ignore"):
        return slow_hz, 1.0 / (1.0 + (slow_hz / frequency_hz) ** _STEEP)
