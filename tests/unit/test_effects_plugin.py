"""Effects of third parties: the example package, and every way in which one can be wrong."""

import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from forefeel.common.causes import registry
from forefeel.common.causes.base import (
    ContactEffect,
    Effect,
    ForceEffect,
    MotionEffect,
    Parameter,
    SensorEffect,
)
from forefeel.common.causes.model import ContactModel

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "effect-package"
GROUP = "forefeel.effects"

Install = Callable[..., None]
FAILS = "fails at its defaults,"


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Makes entry points known, as `name=module:object`, as if their distributions were installed."""

    def install(*points: tuple[str, str]) -> None:
        known = EntryPoints(EntryPoint(name, value, GROUP) for name, value in points)

        def entry_points(group: str, name: str | None = None) -> EntryPoints:
            return known.select(group=group) if name is None else known.select(group=group, name=name)

        monkeypatch.setattr(registry, "entry_points", entry_points)

    registry.effect_class.cache_clear()
    yield install
    registry.effect_class.cache_clear()


@pytest.fixture
def example(install: Install, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """The example package as its own pyproject.toml would install it."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())
    points: dict[str, str] = project["project"]["entry-points"][GROUP]
    monkeypatch.syspath_prepend(EXAMPLE)
    install(*points.items())
    return points


def test_the_example_package_takes_part_in_a_model(example: dict[str, str]) -> None:
    assert list(example) == ["cogging"]
    assert "cogging" in registry.effect_names()
    parameters = {"sine_n": 0.03, "cosine_n": -0.01, "pitch_m": 0.004}
    model = ContactModel.from_mapping(
        {
            "schema": "forefeel.model/1",
            "name": "motor",
            "effects": [{"effect": "cogging", "parameters": parameters}],
        }
    )
    runtime = model.runtime()
    assert runtime.step(0.0, 0.001, 0.0, 0.0, 1e-3) == pytest.approx(0.03)
    assert runtime.step(0.0, 0.002, 0.0, 0.0, 1e-3) == pytest.approx(0.01)
    x = np.linspace(-0.01, 0.02, 300)
    one_by_one = [runtime.step(0.0, at, 0.0, 0.0, 1e-3) for at in x.tolist()]
    np.testing.assert_allclose(runtime.forces_n(x, x, x, x), one_by_one, atol=1e-12)


SIZE: tuple[Parameter, ...] = (Parameter("size_n", "N", 0.0, -1.0, 1.0),)


class Good(ForceEffect):
    name = "good"
    site = "shaft"
    parameters: ClassVar[tuple[Parameter, ...]] = SIZE
    reference = "test"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        return (x,)


class Abstract(ForceEffect):
    name = "abstract"
    site = "shaft"
    parameters = SIZE
    reference = "test"


class Kindless(Effect):
    name = "kindless"
    parameters = SIZE
    reference = "test"


class TwoRegressors(Good):
    name = "two_regressors"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        return (x, v)


class Divides(Good):
    name = "divides"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        return (1.0 / x,)


class Endless(Good):
    name = "endless"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        return (float("nan"),)


class Siteless(Good):
    name = "siteless"
    site = "moon"  # type: ignore[assignment]


class Unbounded(Good):
    name = "unbounded"
    parameters = (Parameter("size_n", "N", 0.0, -1.0, float("inf")),)


class Twice(Good):
    name = "twice"
    parameters = SIZE * 2


class GoodMotion(MotionEffect):
    name = "good_motion"
    parameters = ()
    reference = "test"

    def transform(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, float, float]:
        return 2.0 * x, 2.0 * v, 2.0 * a


class GoodContact(ContactEffect):
    name = "good_contact"
    parameters = ()
    reference = "test"

    def penetration_m(self, x: float, v: float) -> float | None:
        return x if x > 0.0 else None


class GoodSensor(SensorEffect):
    name = "good_sensor"
    parameters = ()
    reference = "test"

    def sense(self, t: float, force_n: float, dt: float) -> float:
        return -force_n


def raises() -> Any:  # noqa: ANN401
    """Not an effect."""


@pytest.mark.parametrize("kind", [Good, GoodMotion, GoodContact, GoodSensor])
def test_every_kind_of_effect_can_be_added_with_no_more_than_it_needs(
    install: Install, kind: type[Effect]
) -> None:
    install((kind.name, f"{__name__}:{kind.__name__}"))
    assert registry.effect_class(kind.name) is kind
    effects = [{"effect": kind.name}, {"effect": "bias", "parameters": {"force_n": 0.1}}]
    model = ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "any", "effects": effects})
    x = np.array([0.0, 0.1, -0.1])
    steps = zip(x.tolist(), [0.0, 0.1, -0.2], strict=True)
    runtime = model.runtime()
    one_by_one = [runtime.step(at, at, at, at, dt) for at, dt in steps]
    np.testing.assert_allclose(model.runtime().forces_n(x, x, x, x), one_by_one)


@pytest.mark.parametrize(
    ("name", "target", "message"),
    [
        ("gone", "no_such_module:Gone", "can not be loaded, ModuleNotFoundError: No module named"),
        ("gone", f"{__name__}:Gone", "can not be loaded, AttributeError: "),
        ("raises", f"{__name__}:raises", "expected a class of forefeel.common.causes.base: ForceEffect"),
        ("kindless", f"{__name__}:Kindless", "expected a class of forefeel.common.causes.base: ForceEffect"),
        ("better", f"{__name__}:Good", "expected an effect named better, its name is 'good'"),
        ("abstract", f"{__name__}:Abstract", "lacks regressors"),
        ("siteless", f"{__name__}:Siteless", "expected a site, one of wall, shaft, sensor"),
        ("unbounded", f"{__name__}:Unbounded", "size_n: expected finite bounds around its default 0.0"),
        ("twice", f"{__name__}:Twice", "expected parameters of different names, not size_n, size_n"),
        (
            "two_regressors",
            f"{__name__}:TwoRegressors",
            f"{FAILS} ValueError: it gives (0.0, 0.0), expected 1",
        ),
        ("divides", f"{__name__}:Divides", f"{FAILS} ZeroDivisionError: float division by zero"),
        ("endless", f"{__name__}:Endless", f"{FAILS} ValueError: it gives (nan,), expected 1 finite number"),
    ],
)
def test_a_bad_plugin_is_one_line_that_names_it(
    install: Install, name: str, target: str, message: str
) -> None:
    install((name, target))
    with pytest.raises(ValueError) as caught:
        ContactModel.from_mapping(
            {"schema": "forefeel.model/1", "name": "any", "effects": [{"effect": name}]}
        )
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
