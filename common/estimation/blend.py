"""Weights of the experts by their past errors.

For each force f that arrives, with p_e the prediction of expert e and h the error of the zero-order hold:

    loss_e = min((p_e - f)^2, c^2 max(h^2, mean h^2)),   c = 0.8 (1 + T / 10 s)
    v_e    = mean (loss_e + (0.003 L)^2) + (0.1 L)^2 / (1 + I / (0.1 L^2) + (T / 6 s)^2)
    w_e    ~ v_e^-4
    reach  = mean of L, and while T < 5 s of the range of the forces where that is larger

The mean is the geometric one of the means of the last 2 s (70 %) and 8 s (30 %), so that an expert which has
become good leads at once; mean h^2 is that of 8 s, the reach that of T / 4, at most 2 s. L is the largest
|f(t) - f(s)| so far, I the integral of h^2, T the time that has been judged. All is relative to L, not to the
range of the forces: by the range, recordings at rest went to ten times the error of the hold.

The cap: an early extrapolation far off must not keep an expert out for 8 s. The last term of v_e makes all
alike while little is known. With 0.2 L, that kept the odd expert in the lead for ten seconds where others had
long been better. It is not for the favoured one, which is the odd expert (the first reversal).

A contact that another run has taught, by a prior or a model.yaml, is none of these experts, which then blend
among themselves. Their blend and the two members of the contact share the weight by

    s ~ (mean loss + (0.003 L)^2)^-4,   of the contact times (1 + 100 / (1 + (T / 0.3 s)^2)) / 1.5^4

with the mean of the newest eighth of T, and no cap: what was learned elsewhere may be wrong altogether, and
is to go at its first contradiction. As one of the experts it kept for 8 s the lead from when they had learned
nothing: of 80 recordings with the model of their own diagnosis 17 were predicted over 2 % worse with it than
without, from 3.3 s on, and are 3; the geometric mean of the ratios was 0.64 and is 0.60.

The blend, without a taught contact, goes no further than the reach from the newest force. Of a change larger
than all before the experts have learned the beginning alone, and foretell more of its size: 1.6 times the
error of the hold where an elastomer is let go, and 1.1 with the reach.

What the contact c leaves of a force fades until that force arrives. Of r(s) = f(s) - c(s), at the stamp s of
the newest force, its second member keeps the part that lasts, within 0 and 1:

    c(t) + rho r(s),   rho = (sum r(s) (f(t) - c(t)) + p) / (sum r(s)^2 + p),   p = (0.1 L)^2 s,

sums over 8 s. With rho = 1 eleven of twelve guidewires in vessels of another engine are predicted worse, up
to 10 %. Of a taught contact rho is 1: one that is wrong would stay longer, 13 % more error in its first 3 s.

To v_e of the contact sigma^2 is added, what its last fit left unexplained: losses are those of the fits
before, and a fit to forces that no contact gives says anything at the next place. On a spring that is let go
that makes 1.6 of 2.7 times the error of the hold. It fades as 1 / (1 + (T / 6 s)^2) for the second member.

An expert without a prediction (NaN) is judged as the hold, and has no weight.
"""

from typing import Annotated, Protocol

import numpy as np

from forefeel.common.estimation import experts
from forefeel.common.kernels.record import Array

NAMES = ("zoh", *experts.NAMES, "contact", "contact, persistent")
ZOH, FIRST, CONTACT = 0, 1, 1 + len(experts.NAMES)
"""The hold, the five experts, the contact model, and last the same with what lasts of its residual."""
MEMBERS = len(NAMES)
RIVALS = 1 + MEMBERS - CONTACT


class Blend(Protocol):
    """Sums of weighted losses by memory, of h^2 within 8 s, and of the weights; I; T; L; reach; sigma; rho
    and its sums; w.

    taught: 1 while another run has taught the contact. rivals_n2: mean squared errors of the newest eighth of
    T: of the blend of the others, and of the two members of the contact.
    """

    seen_fast: float
    seen_slow: float
    zoh_n2: float
    informed_n2: float
    known_s: float
    largest_n: float
    reach_n: float
    unexplained_n: float
    residual_n2: float
    persistent_n2: float
    persistence: float
    taught: float
    losses: Annotated[Array, 2, MEMBERS]
    weights: Annotated[Array, MEMBERS]
    rivals_n2: Annotated[Array, RIVALS]


def begin(blend: np.void, taught: bool) -> None:
    """Initialises a record of zeros: all weight is on the change of a taught contact, else on the hold."""
    blend["weights"][CONTACT + 1 if taught else ZOH] = 1.0
    blend["taught"], blend["persistence"] = taught, 1.0
