"""Effects of third parties: the example package, how each can be wrong, and the causes that they are."""

import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from scipy.signal import lfilter

from forefeel.common.causes import base, registry
from forefeel.common.causes.candidate import Fitted
from forefeel.common.causes.catalogue import CANDIDATES, refresh
from forefeel.common.causes.motion import Kinematics, Memory, Motion, MotionSample, Value
from forefeel.common.error_size import Floats
from forefeel.common.estimation.contact_model import Causes
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.diagnosis.regression import RecordingRegression
from forefeel.diagnosis.search import Search
from forefeel.diagnosis.signals import Signals
from forefeel.results.curves import Curves
from forefeel.results.pictures import picture
from tests.unit.model_samples import effect, model

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "effect-package"
GROUP = "forefeel.effects"
RATE_HZ = 250.0
PITCH_M, SINE_N, COSINE_N = 0.00371, 0.043, -0.021

Install = Callable[..., None]
FAILS = "fails at its defaults,"


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Makes entry points known, as `name=module:object`, as if their distributions were installed."""
    known = EntryPoints()

    def entry_points(group: str, name: str | None = None) -> EntryPoints:
        return known.select(group=group) if name is None else known.select(group=group, name=name)

    def install(*points: tuple[str, str]) -> None:
        nonlocal known
        known = EntryPoints(EntryPoint(name, value, GROUP) for name, value in points)
        registry.effect_class.cache_clear()

    monkeypatch.setattr(registry, "entry_points", entry_points)
    monkeypatch.syspath_prepend(EXAMPLE)
    yield install
    install()
    refresh()
    registry.effect_class.cache_clear()


@pytest.fixture
def example() -> tuple[str, str]:
    """The entry point that the package's own pyproject.toml declares."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())
    ((name, value),) = project["project"]["entry-points"][GROUP].items()
    return name, value


SIZE: tuple[base.Parameter, ...] = (base.Parameter("size_n", "N", 0.0, -1.0, 1.0),)


class Good(base.ForceEffect):
    name = "good"
    site = "shaft"
    parameters: ClassVar[tuple[base.Parameter, ...]] = SIZE
    reference = "test"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (m.x,)


class Abstract(base.ForceEffect):
    name = "abstract"
    site = "shaft"
    parameters = SIZE
    reference = "test"


class TwoRegressors(Good):
    name = "two_regressors"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (m.x, m.v)


class Branching(Good):
    name = "branching"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (m.x if m.x > 0.0 else 0.0,)


class Siteless(Good):
    name = "siteless"
    site = "moon"  # type: ignore[assignment]


class Unbounded(Good):
    name = "unbounded"
    parameters = (base.Parameter("size_n", "N", 0.0, -1.0, float("inf")),)


class GoodMotion(base.MotionEffect):
    name = "good_motion"
    parameters = ()
    reference = "test"

    def moved(self, m: Kinematics) -> Kinematics:
        return m.along(2.0 * m.x, 2.0 * m.v, 2.0 * m.a)


class GoodContact(base.ContactEffect):
    name = "good_contact"
    parameters = ()
    reference = "test"

    def contact(self, m: Kinematics) -> tuple[Value, Value]:
        return m.depth, m.above(m.x)


class GoodSensor(base.SensorEffect):
    name = "good_sensor"
    parameters = ()
    reference = "test"

    def reading(self, m: Kinematics, force_n: Value) -> Value:
        return -force_n


class Sum(Memory):
    def step(self, u: float) -> Value:
        self.value += u
        return self.value


class Integral(Good):
    """A memory that gives only its step, and a function that is written for floats."""

    name = "integral"
    distance = Sum()

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (m.through(self.distance, m.elementwise(lambda v, dt: abs(v) * dt, m.v, m.dt)),)


def test_a_memory_of_its_own_needs_no_more_than_its_step() -> None:
    effect, again, t, v = Integral(), Integral(), np.array([1.0, 2.0, 4.0]), np.array([3.0, 1.0, -2.0])
    motion = Motion.of(t, v, v, v)
    (distance,) = effect.regressors(motion)
    assert distance.tolist() == [0.0, 1.0, 5.0]
    assert effect.regressors(MotionSample(5.0, 0.0, 2.0, 0.0, 1.0)) == (2.0,)
    assert effect.remembers and again.regressors(MotionSample(5.0, 0.0, 0.0, 0.0, 1.0)) == (0.0,)
    effect.reset()
    assert effect.regressors(MotionSample(5.0, 0.0, 0.0, 0.0, 1.0)) == (0.0,)


@pytest.mark.parametrize("kind", [Good, GoodMotion, GoodContact, GoodSensor, Integral])
def test_every_kind_of_effect_can_be_added_with_no_more_than_it_needs(
    install: Install, kind: type[base.Effect]
) -> None:
    install((kind.name, f"{__name__}:{kind.__name__}"))
    assert registry.effect_class(kind.name) is kind
    both = model(effect(kind.name), effect("bias", force_n=0.1))
    x = np.array([0.0, 0.1, -0.1])
    steps = zip(x.tolist(), [0.0, 0.1, -0.2], strict=True)
    runtime = both.runtime()
    one_by_one = [runtime.step(at, at, at, at, dt) for at, dt in steps]
    np.testing.assert_allclose(both.runtime().forces_n(Motion.of(x, x, x, x)), one_by_one)


@pytest.mark.parametrize(
    ("name", "target", "message"),
    [
        ("gone", "no_such_module:Gone", "can not be loaded, ModuleNotFoundError: No module named"),
        ("gone", f"{__name__}:Gone", "can not be loaded, AttributeError: "),
        ("raises", "pathlib:Path", "expected a class of forefeel.common.causes.base: ForceEffect"),
        ("better", f"{__name__}:Good", "expected an effect named better, its name is 'good'"),
        ("abstract", f"{__name__}:Abstract", "lacks regressors"),
        ("branching", f"{__name__}:Branching", f"{FAILS} ValueError: The truth value of an array"),
        ("siteless", f"{__name__}:Siteless", "expected a site, one of wall, shaft, sensor"),
        ("unbounded", f"{__name__}:Unbounded", "size_n: expected finite bounds around its default 0.0"),
        ("two_regressors", f"{__name__}:TwoRegressors", f"{FAILS} ValueError: (0.01, 0.02, 0.5, 0.02, 0.01,"),
    ],
)
def test_a_bad_plugin_is_one_line_that_names_it(
    install: Install, name: str, target: str, message: str
) -> None:
    install((name, target))
    with pytest.raises(ValueError) as caught:
        model(effect(name))
    assert str(caught.value).startswith(
        f"effects[0].effect: entry point forefeel.effects:{name} = {target}: {message}"
    )
    assert "\n" not in str(caught.value)


def test_two_plugins_of_one_name_are_refused(install: Install) -> None:
    install(("good", "other:Good"), ("good", f"{__name__}:Good"))
    with pytest.raises(ValueError, match=r"^entry point forefeel\.effects:good: other:Good and "):
        registry.effect_class("good")


def test_a_bad_plugin_does_not_disturb_the_others(install: Install) -> None:
    points = ("gone", "no_such_module:Gone"), ("good", f"{__name__}:Good"), ("bias", f"{__name__}:Good")
    install(*points)
    assert registry.effect_class("good") is Good
    assert registry.effect_class("bias") is registry.OWN["bias"]
    assert {"gone", "good"} <= set(registry.effect_names())


def _rippled(seconds: float = 12.0) -> tuple[Recording, Floats]:
    """Strokes over eight pitches, with the force's noise of a load cell; and the force without it."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    w, size = 2.0 * np.pi * np.array([0.23, 0.71, 1.9, 5.3]), np.array([9e-3, 4e-3, 1e-3, 1e-4])
    phase = np.outer(t, w) + np.array([0.0, 1.0, 2.0, 3.0])
    x, v, a = np.sin(phase) @ size, np.cos(phase) @ (size * w), -np.sin(phase) @ (size * w * w)
    turn = 2.0 * np.pi * x / PITCH_M
    force = 0.03 * a + 0.9 * v + 25.0 * x + SINE_N * np.sin(turn) + COSINE_N * np.cos(turn)
    noise = lfilter([1.0], [1.0, -0.7], np.random.default_rng(1).standard_normal(len(t)))
    return Recording("made", t, x, force + 2e-3 * noise / np.std(noise), "test"), force


def test_a_cause_of_the_example_package_is_named_drawn_and_loaded_and_without_it_the_map_that_holds_it(
    install: Install, example: tuple[str, str]
) -> None:
    recording, force = _rippled()
    install(example)
    found = diagnose(recording)
    assert found.diagnosis.verdict == "cause_found"
    (cause,) = found.diagnosis.causes
    assert cause.name == "cogging"
    assert cause.parameters["pitch_m"].value == pytest.approx(PITCH_M, rel=2e-3)
    assert cause.parameters["sine_n"].value == pytest.approx(SINE_N, rel=0.1)
    assert cause.parameters["cosine_n"].value == pytest.approx(COSINE_N, rel=0.1)
    assert "ripple" in cause.evidence.fingerprint
    extended = extended_model(found.analysis, "motor")
    assert [entry.effect for entry in extended.effects] == ["mass_damper_spring", "cogging"]
    x, t = recording.position_m, recording.time_s
    v = np.gradient(x, t)
    said = extended.runtime().forces_n(Motion.of(t, x, v, np.gradient(v, t)))
    assert np.std((said - force)[100:-100]) < 2e-3
    assert picture(Curves.of(found.analysis, None), "cogging").title == "Over the position"
    prior = Causes(extended).with_loaded(None)
    assert prior is not None and prior.values[prior.names.index("cogging.sine_n")] == pytest.approx(
        cause.parameters["sine_n"].value
    )
    install()
    (own,) = diagnose(recording).diagnosis.causes
    assert own.name == "position_map"
    assert own.parameters["period_m"].value == pytest.approx(PITCH_M, rel=2e-3)
    assert own.parameters["sine_n"].value == pytest.approx(SINE_N, rel=0.1)
    assert "cogging" not in CANDIDATES


class Threshold(base.ForceEffect):
    """A smoothed step of the force at a position that may have either sign."""

    name = "threshold"
    site = "shaft"
    parameters = (
        base.Parameter("step_n", "N", 0.0, 0.0, 10.0),
        base.Parameter("position_m", "m", 0.0, -1.0, 1.0, linear=False),
        base.Parameter("width_m", "m", 1e-3, 1e-5, 1e-1, linear=False),
    )
    reference = "test"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        depth = (m.x - self.values["position_m"]) / self.values["width_m"]
        return (2.0 / (1.0 + m.exp(-2.0 * m.clip(depth, -50.0, 50.0))) - 1.0,)


def test_two_shapes_one_of_either_sign_are_searched_and_named(install: Install) -> None:
    install(("threshold", f"{__name__}:Threshold"))
    refresh()
    recording, _ = _rippled()
    x = recording.position_m
    v = np.gradient(x, recording.time_s)
    force = 0.9 * v + 25.0 * x + 0.08 * np.tanh((x + 2.3e-3) / 7e-4)
    signals = Signals(
        Recording("made", recording.time_s, x, force, "test"), force, 30.0, np.zeros(len(x), dtype=np.bool_)
    )
    search = Search(RecordingRegression(signals, 1e-5))
    assert "threshold" in search.names
    found = search.best_with(search.fit({}), "threshold")
    assert found is not None
    fitted = Fitted(found.of("threshold"), found.model["threshold"], found.coefficients[:3], 0.0)
    named = CANDIDATES["threshold"].named(fitted)
    assert named["position_m"] == pytest.approx(-2.3e-3, abs=1e-4)
    assert named["width_m"] == pytest.approx(7e-4, rel=0.1)
    assert named["step_n"] == pytest.approx(0.08, rel=0.05)
    assert CANDIDATES["threshold"].signs == (1,)


def test_what_can_not_be_searched_is_said_and_breaks_nothing(install: Install) -> None:
    install(("good_motion", f"{__name__}:GoodMotion"), ("missing", f"{__name__}:Missing"))
    lines: list[str] = []
    known = set(CANDIDATES)
    refresh(lines.append)
    assert set(CANDIDATES) == known
    assert any("good_motion adds no force" in line for line in lines)
    assert any("missing" in line and "can not be loaded" in line for line in lines)
