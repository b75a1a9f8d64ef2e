"""Whatever is learned of a contact is finite, and so is its force; good data mend it."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.common.estimation.contact import Contact, ContactExpert, ContactFit
from tests.unit.contact_samples import samples, session

GOOD = list(samples(session(2.0)))
BAD = st.sampled_from([0.0, 1e-12, -1e-12, 1.0, -3.0, 1e300, -1e300, float("nan"), float("inf")])
PIECES = st.tuples(
    st.tuples(BAD, BAD, BAD, BAD), st.sampled_from([1e-12, 0.004, 0.05, 3.0]), st.integers(1, 80)
)


@settings(max_examples=20)
@given(pieces=st.lists(PIECES, max_size=4))
def test_contact_of_bad_samples_is_finite_and_mended(
    pieces: list[tuple[tuple[float, float, float, float], float, int]],
) -> None:
    fit, expert, t_s = ContactFit(), ContactExpert(), 0.0

    def observe(x: float, v: float, a: float, force_n: float) -> None:
        fit.observe(t_s, x, v, a, force_n)
        if (job := fit.due()) is not None:
            fit.apply(job.solve())
            if fit.contact is not None:
                assert_finite(fit.contact)
                expert.use(fit.contact)

    for signal, dt_s, count in pieces:
        for _ in range(count):
            t_s += dt_s
            observe(*signal)
    start_s = t_s + 0.5
    for t, *sample in GOOD:
        t_s = start_s + t
        observe(*sample)

    x, v, a, _ = GOOD[-1][1:]
    assert fit.contact is not None
    assert np.isfinite(expert.move(t_s, x, v, a, 0.004))


def assert_finite(contact: Contact) -> None:
    assert np.isfinite([*contact.theta, *contact.values, *contact.standard_deviations, contact.noise_n]).all()
    contact.prior()
