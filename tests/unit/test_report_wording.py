"""Numbers, parameters and their units in words."""

import pytest

from forefeel.common.causes.registry import OWN
from forefeel.common.events.text import quantity, units_of
from forefeel.diagnosis.verdict import Interval
from forefeel.report.wording import (
    micros,
    number,
    plain_value,
    ratio,
    share,
    shown,
    split_unit,
    statement_text,
)

UNITLESS = {"ratio", "damping_ratio"}


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (0.0, "0 N"), (0.0123, "12.3 mN"), (0.9996, "1 N"), (1.0, "1 N"), (1e-12, "0.001 nN")],
)
def test_quantities_have_three_digits_and_a_prefix(value: float | None, text: str) -> None:
    assert quantity(value, "N") == text


def test_other_words() -> None:
    assert micros(1500.0) == "1.5 ms"
    assert (share(0.99999), share(1.0)) == ("99.9 %", "100 %")
    assert (ratio(1.3), ratio(None)) == ("1.30", "–")
    assert number(1234567).replace("\N{NARROW NO-BREAK SPACE}", " ") == "1 234 567"
    assert number(0.123456) == "0.1235"
    assert (plain_value("mass_kg", 0.02), plain_value("rate_hz", 0.5)) == ("20 g", "0.5 Hz")


@pytest.mark.parametrize(
    ("name", "interval", "text"),
    [
        ("force_n", Interval(0.0601, 0.0592, 0.061), "force 60.1 mN (59.2 to 61.0)"),
        ("stribeck_velocity_m_s", Interval(4e-4, 1e-4, 9e-4), "stribeck velocity 400 µm/s (100 to 900)"),
        ("forward_n_s_m", Interval(168.76, 164.62, 172.96), "forward 168.8 N s/m (164.6 to 173.0)"),
        ("damping_ratio", Interval(0.0512, 0.04, 0.06), "damping ratio 0.051 (0.040 to 0.060)"),
        ("cubic_n_m3", Interval(3.412e6, 3.3e6, 3.5e6), "cubic 3.41e+06 N/m³ (3.3e+06 to 3.5e+06)"),
        ("ratio", Interval(float("inf"), 1.0, 2.0), "ratio unknown (1 to 2)"),
    ],
)
def test_parameter_has_unit_and_digits_of_its_interval(name: str, interval: Interval, text: str) -> None:
    assert str(shown(name, interval)) == text


def test_a_statement_names_no_field() -> None:
    stated = "heart.rate_hz and bias.force_n only as bias.force_n - 0.135 heart.rate_hz"
    assert statement_text(stated) == "heart: rate and bias: force only as bias: force - 0.135 heart: rate"
    assert statement_text("mass_damper_spring.mass_kg and stress_re ...") == "mass and stress re ..."


def test_the_unit_of_a_name_is_that_of_the_effect() -> None:
    assert split_unit("damping_ratio") == ("damping ratio", "")
    for name in OWN:
        for parameter in OWN[name].parameters:
            if parameter.name not in UNITLESS and parameter.unit:
                said = split_unit(parameter.name)[1].replace("²", "^2").replace("³", "^3")
                assert said == parameter.unit, parameter.name


@pytest.mark.parametrize(
    ("position", "force", "texts"),
    [
        ("deg:a", "mNm:t", ("20 g m²", "800 ms", "7 N m/rad", "12.3 mN m")),
        ("turn:a", "Nm:t", ("20 g m²", "800 ms", "7 N m/rad", "12.3 mN m")),
        ("rad:a", "N:f", ("20 g m", "800 ms", "7 N/rad", "12.3 mN")),
    ],
)
def test_quantities_of_a_rotation_have_its_units(position: str, force: str, texts: tuple[str, ...]) -> None:
    values = {"mass_kg": 0.02, "time_constant_s": 0.8, "stiffness_n_m": 7.0, "force_n": 0.0123}
    with units_of({"position": position, "force": force}):
        assert tuple(plain_value(*each) for each in values.items()) == texts
