import json

import numpy as np
import pytest

from forefeel.report.drawing import BINS, Figure, binned, limits, line, panel, spec, thin
from forefeel.report.template import environment


def test_thin_traces_keep_every_peak_and_show_gaps() -> None:
    rng = np.random.default_rng(5)
    time_s = np.concatenate((np.arange(0, 10, 1e-3), np.arange(20, 30, 1e-3)))
    values = rng.normal(size=len(time_s))
    values[1234], values[15_678] = 50.0, -60.0
    x, y = thin(time_s, 0.25, values).T
    assert len(x) <= 2 * BINS + 2
    assert np.all(np.diff(x) >= 0)
    assert (np.nanmax(y), np.nanmin(y)) == (50.0, -60.0)
    assert x[np.argmax(np.nan_to_num(y))] == pytest.approx(1.234, abs=30 / BINS)
    inside = x[np.isnan(y)]
    assert len(inside)
    assert np.all((inside > 10) & (inside < 20))


def test_spec_rounds_to_pixels_and_cuts_what_is_far_off() -> None:
    y = np.array([0.123456789, np.nan, 1e300])
    made = spec(
        [panel("force, N", limits(y[:1], np.array([0.0, 1.0])), lines=[line("a", "late", np.arange(3.0), y)])]
    )
    assert made["x"] == {"min": 0, "max": 2}
    rows = made["panels"][0]["lines"][0]["rows"]
    assert rows[:2] == [(0.0, 0.12346), (1.0, None)] and 1.0 < rows[2][1] < 3.0
    drawn = spec([panel("", {"log": True}, lines=[line("", "late", y[:1], 1e-5 * y[:1])])], log=True)
    assert drawn["panels"][0]["lines"][0]["rows"] == [(0.1235, 1.235e-6)]


def test_hostile_names_stay_inside_the_data_of_a_figure() -> None:
    name = "</script><b> & '"
    figure = Figure("title", "", 100, (spec([panel(name)]),))
    page = environment().from_string('{% from "report/parts.html.j2" import picture %}{{ picture(figure) }}')
    data = page.render(figure=figure).partition('json">')[2].partition("</script>")[0]
    assert json.loads(data)["panels"] == [{"title": name}]


def test_means_are_those_of_their_bins() -> None:
    x = np.linspace(0.0, 1.0, 1001)
    along, up = binned(x, 3.0 * x + 1.0, 20)
    assert up == pytest.approx(3.0 * along + 1.0)
    assert np.all(np.diff(along) > 0.0)


def test_limits_hold_every_trace_and_zero_where_it_is_wanted() -> None:
    assert limits(np.array([2.0, np.nan, 3.0]), np.array([4.0])) == {"min": 1.88, "max": 4.12}
    assert limits(np.array([2.0, 4.0]), zero=True) == {"min": -0.24, "max": 4.24}
    assert limits(np.array([0.0, 1.0]), beside=np.array([-100.0, 0.5])) == {"min": -2.06, "max": 1.06}
