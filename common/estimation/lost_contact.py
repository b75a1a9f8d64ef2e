"""Loss of the contact that was learned: the wall gave way. Pure.

A zero at a place that was not touched before says nothing. One that answers a motion deeper than the
remembered contact, by more than its band in place and in force, says that the wall is gone: what was learned
of it would be felt where nothing is. A wall that moves with heart or breath stays within that band.
"""

from math import inf

from forefeel.common.estimation.contact_fit import Contact
from forefeel.common.estimation.contact_model import WAVES
from forefeel.common.estimation.contact_prior import CONTACT

_LASTS_S = 0.03  # a force that crosses zero is no wall that is gone
_ZERO = 0.1  # of the force that the contact foretold
_LEAST_S, _OUT_S = 0.5, 2.0  # of contact; on the way out, where friction that turns may make a zero
_DEVIATIONS, _NOISES = 3.0, 8.0  # of the place of the contact; of what the contact model leaves unexplained
_KEEPS = 0.9  # of what was unexplained, by fit: a fit that begins anew has not seen yet how the wall moves
_MOVES, _MOVES_S = 0.3, 1.5  # of how deep it was touched, until some seconds of contact have shown the motion


class LostContact:
    """Detects, by forces in the order of their stamps, that the wall has given way."""

    def __init__(self) -> None:
        self._contact: Contact | None = None
        self._since_s, self._deepest_m = inf, -inf
        self._noise_n = self._place_m = self._force_n = self._moves = 0.0

    def judge(
        self, t_s: float, x_m: float, v_m_s: float, force_n: float, foretold_n: float, contact: Contact
    ) -> bool:
        """True once the force has been near 0 for 30 ms where the contact foretells one: the wall is gone.

        Counts only places beyond the contact's by a margin, and a foretold force beyond the noise. False if
        the contact has no position, is hardly known or does not foretell the force. Keeps the start of the
        zero and the deepest place touched. `x_m`, `v_m_s`: of the stage; both forces less that of no contact.
        """
        if CONTACT not in contact.names or contact.contact_s < (_OUT_S if v_m_s < 0.0 else _LEAST_S):
            return False  # touched everywhere, or hardly known
        if contact.by_place:
            return False  # foretold without the wall
        if contact is not self._contact:
            self._set_margins(contact)
        deep_m, deepest_m = x_m - contact.shape[0], self._deepest_m - contact.shape[0]
        beyond = deep_m > self._place_m + self._moves * max(0.0, deepest_m)
        if beyond and foretold_n > self._force_n and abs(force_n) < _ZERO * foretold_n:
            self._since_s = min(self._since_s, t_s)
        else:
            self._since_s, self._deepest_m = inf, max(self._deepest_m, x_m)
        return t_s - self._since_s > _LASTS_S

    def _set_margins(self, contact: Contact) -> None:
        """Sets the margins in force and place for the forces from now on, by those of a new fit."""
        known = dict(zip(contact.names, contact.values, strict=True))
        self._contact, self._noise_n = contact, max(contact.noise_n, _KEEPS * self._noise_n)
        self._force_n = _NOISES * self._noise_n + 2.0 * sum(abs(known.get(wave, 0.0)) for wave in WAVES)
        self._place_m = _DEVIATIONS * contact.standard_deviations[contact.names.index(CONTACT)]
        self._moves = _MOVES / (1.0 + (contact.contact_s / _MOVES_S) ** 2)
