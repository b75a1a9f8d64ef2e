from xml.etree import ElementTree

import numpy as np
import pytest

from forefeel.report.drawing import BINS, drawn, limit_y, means, new_figure, one_plot, thin


def test_thin_traces_keep_every_peak_and_show_gaps() -> None:
    rng = np.random.default_rng(5)
    time_s = np.concatenate((np.arange(0, 10, 1e-3), np.arange(20, 30, 1e-3)))
    values = rng.normal(size=len(time_s))
    values[1234], values[15_678] = 50.0, -60.0
    x, y = thin(time_s, values)
    assert len(x) <= 2 * BINS + 2
    assert np.all(np.diff(x) >= 0)
    assert np.nanmax(y) == 50.0
    assert np.nanmin(y) == -60.0
    assert x[np.argmax(np.nan_to_num(y))] == pytest.approx(1.234, abs=30 / BINS)
    inside = x[np.isnan(y)]
    assert len(inside)
    assert np.all((inside > 10) & (inside < 20))


def test_short_traces_stay_as_they_are() -> None:
    time_s, values = np.arange(5.0) / 10, np.array([1.0, 2.0, np.nan, 3.0, 4.0])
    x, y = thin(time_s[::-1], values[::-1])
    np.testing.assert_array_equal(x, time_s)
    np.testing.assert_array_equal(y, values)


def test_titles_of_drawings_are_escaped() -> None:
    figure = new_figure(1.0)
    figure.subplots().set_title("<a> & b")
    drawing = drawn(figure, "name", 'a "title" \\1 <b>', "")
    assert ElementTree.fromstring(drawing.svg).get("aria-label") == 'a "title" \\1 <b>'


def test_means_are_those_of_their_bins() -> None:
    x = np.linspace(0.0, 1.0, 1001)
    along, up = means(x, 3.0 * x + 1.0, 20)
    assert up == pytest.approx(3.0 * along + 1.0)
    assert np.all(np.diff(along) > 0.0)


def test_limits_hold_every_trace_and_zero_where_it_is_wanted() -> None:
    _, axes = one_plot(1.0)
    limit_y(axes, np.array([2.0, np.nan, 3.0]), np.array([4.0]))
    assert axes.get_ylim() == pytest.approx((2.0 - 0.12, 4.0 + 0.12))
    limit_y(axes, np.array([2.0, 4.0]), zero=True)
    assert axes.get_ylim() == pytest.approx((-0.24, 4.24))
    limit_y(axes, np.array([0.0, 1.0]), beside=np.array([-100.0, 0.5]))
    assert axes.get_ylim() == pytest.approx((-2.06, 1.06))
