"""What the force limit may rely on while the load cell is blind. Pure."""

_BLIND_SHARE = 0.9
"""A blind cell may hide that the force grew: from this share of the limit on the stage may only relieve."""


class ForceWatch:
    """Keeps the newest force that can be believed, and how long there has been none.

    A reading that is not valid may still say more than the one before: a saturated cell knows the sign, and
    the least size. So until the next valid reading the largest counts.

    Attributes:
        force_n: the force that the limit respects.
        limit_share: the share of the limit from which on it acts.
    """

    def __init__(self, timeout_s: float | None) -> None:
        """`timeout_s`: how long the cell may stay blind while the stage follows.

        None: for ever, as a recorded force is between its pieces; then a reading counts as it is.
        """
        self.force_n = 0.0
        self.limit_share = 1.0
        self._timeout_s = timeout_s
        self._seen_ns: int | None = None

    def take(self, force_n: float, valid: bool) -> None:
        """The reading of this tick."""
        if valid or self._timeout_s is None:
            self.force_n, self.limit_share = force_n, 1.0
            return
        self.limit_share = _BLIND_SHARE
        if abs(force_n) > abs(self.force_n):
            self.force_n = force_n

    def fault(self, now_ns: int, valid: bool, following: bool) -> str | None:
        """Why the stage may not follow any longer: the cell has been blind for too long."""
        if valid or self._timeout_s is None or not following:
            self._seen_ns = now_ns
        elif self._seen_ns is not None and now_ns - self._seen_ns > self._timeout_s * 1e9:
            return f"load cell invalid for more than {self._timeout_s:g} s"
        return None
