"""Contact force by place: found in a bent vessel, kept for the next session, left where causes do better."""

from dataclasses import asdict, replace
from datetime import date
from itertools import accumulate
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.common.estimation.contact import Contact, ContactExpert, ContactFit
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.path_force import NODES, PathForce, path_force
from forefeel.common.prior_file import keep_prior, load_prior, prior_path
from tests.unit.evaluation_samples import Floats

RATE_HZ, LENGTH_M = 250.0, 1e-4


def moved(seconds: float) -> Floats:
    """Strokes of 20 to 50 mm, with a tremor."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    strokes = 0.0175 + 0.0175 * np.sin(2.1 * t) * np.sin(0.37 * t) + 0.007 * np.sin(0.9 * t)
    return np.asarray(strokes + 2e-4 * np.sin(50.0 * t))


def bent(x: Floats) -> tuple[Floats, Floats]:
    """Elastic force and friction in N of a vessel with two bends."""
    elastic = 0.05 * np.sin(x / 0.006) + 1.5 * x
    return elastic, 0.02 + 0.015 * np.cos(x / 0.009)


def directions(x: Floats) -> Floats:
    steps = (np.diff(x, prepend=x[:1]) / LENGTH_M).tolist()
    return np.array([*accumulate(steps, lambda state, step: min(max(state + step, -1.0), 1.0))])


def force(x: Floats, seed: int = 0) -> Floats:
    elastic, friction = bent(x)
    noise = np.random.default_rng(seed).normal(0.0, 1e-3, len(x))
    return np.asarray(elastic + friction * directions(x) + noise)


def fitted(x: Floats, force_n: Floats, prior: PathForce | None = None) -> PathForce:
    path = path_force(x, force_n, np.full(len(x), 0.04), None, prior)
    assert path is not None
    return path


def test_elastic_force_and_friction_are_found_by_place() -> None:
    x = moved(30.0)
    path = fitted(x, force(x))
    places = np.linspace(np.quantile(x, 0.02), np.quantile(x, 0.98), 50)
    elastic, friction = path.nodes_n(places).reshape(2, -1)
    assert np.std(elastic - bent(places)[0]) < 3e-3
    assert np.std(friction - bent(places)[1]) < 3e-3
    assert LENGTH_M / 1.5 < path.length_m < 1.5 * LENGTH_M
    assert path.noise_n < 3e-3
    other = moved(50.0)[-3000:]
    left_n = force(other, 1) - path.along(other)
    assert np.std(left_n) < 0.1 * np.std(force(other, 1))


def test_force_step_by_step_is_that_along_positions_and_stays_beyond_the_ends() -> None:
    x = moved(5.0)
    path = replace(fitted(moved(30.0), force(moved(30.0))), length_m=LENGTH_M)
    states = zip(x.tolist(), directions(x).tolist(), strict=True)
    assert [path.at(*state) for state in states] == pytest.approx(path.along(x).tolist(), abs=1e-12)
    end_m = path.low_m + (NODES - 1) * path.step_m
    assert path.at(end_m + 0.01, 0.5) == path.at(end_m, 0.5)
    assert path.at(path.low_m - 0.01, 0.5) == path.at(path.low_m, 0.5)


def test_prior_holds_where_the_motion_has_not_been() -> None:
    x = moved(30.0)
    known = fitted(x, force(x))
    shallow = 0.3 * moved(6.0)
    path = fitted(shallow, force(shallow) + 0.05, known)  # another zero of the cell
    deep = np.linspace(0.02, 0.035, 30)
    off_n = path.nodes_n(deep) - known.nodes_n(deep)
    assert off_n[:30] == pytest.approx(0.05, abs=0.01)
    assert off_n[30:] == pytest.approx(0.0, abs=0.01)
    assert path_force(np.full(100, 0.01), np.arange(100.0), np.ones(100), None) is None  # without motion


def contact_of(force_n: Floats, x: Floats) -> Contact:
    fit, v = ContactFit(), np.gradient(x) * RATE_HZ
    a = np.gradient(v) * RATE_HZ
    for k, row in enumerate(np.column_stack([x, v, a, force_n]).tolist()):
        fit.observe(k / RATE_HZ, *row)
        if (due := fit.due()) is not None:
            fit.apply(due.solve())
    assert fit.contact is not None
    return fit.contact


def test_force_by_place_comes_into_use_in_a_bent_vessel_and_starts_the_next_session(tmp_path: Path) -> None:
    x = moved(15.0)
    contact = contact_of(force(x), x)
    assert contact.by_place and contact.path is not None
    assert contact.left_n == contact.path.noise_n < 0.5 * contact.noise_n
    keep_prior(tmp_path, "wire", "one", contact.prior(), date(2026, 1, 1))
    stored = load_prior(prior_path(tmp_path, "wire", "one"))
    assert stored is not None and stored.prior().path == contact.path
    next_one = ContactFit(stored.prior()).contact
    assert next_one is not None and next_one.by_place
    expert = ContactExpert()
    expert.use(next_one)
    other = moved(15.0)[1000:3000]
    v = np.gradient(other) * RATE_HZ
    rows = enumerate(zip(other.tolist(), v.tolist(), strict=True))
    said = [expert.move(k / RATE_HZ, place, speed, 0.0, 1.0 / RATE_HZ) for k, (place, speed) in rows]
    assert np.std(np.array(said) - force(other, 2)) < 0.15 * np.std(force(other, 2))


def test_causes_stay_in_use_where_they_explain_the_force() -> None:
    x = moved(15.0)
    v = np.gradient(x) * RATE_HZ
    noise = np.random.default_rng(1).normal(0.0, 1e-3, len(x))
    contact = contact_of(np.asarray(6.0 * np.maximum(x - 0.01, 0.0) + 0.4 * v * (x > 0.01) + noise), x)
    assert not contact.by_place and contact.prior().path is None


def test_stored_force_by_place_of_another_shape_is_refused(tmp_path: Path) -> None:
    path = fitted(moved(30.0), force(moved(30.0)))
    with pytest.raises(ValueError, match="32 places"):
        replace(path, elastic_n=(0.0,))
    with pytest.raises(ValueError, match="above 0"):
        PathForce(**{**asdict(path), "step_m": 0.0})
    prior = ContactPrior(("a_n",), (1.0,), ((1.0,),), 10.0, path)
    keep_prior(tmp_path, "wire", "one", prior, date(2026, 1, 1))
    file = prior_path(tmp_path, "wire", "one")
    file.write_text(file.read_text().replace('"step_m": ', '"step_m": -'))
    with pytest.raises(ConfigurationError, match="above 0"):
        load_prior(file)
