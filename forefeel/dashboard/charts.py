"""The charts before anything is drawn: axes, lines, colours (Okabe and Ito) and no animation."""

from typing import Any

_SOFT, _RULE = "#97a4b4", "#242d37"
_FELT, _PREDICTED, _MEASURED, _READBACK = "#2fc296", "#56b4e9", "#f2f4f7", "#ff8f4d"
_LEFT_PX, _RIGHT_PX = 52, 12  # pixels beside the charts; on the left there are the numbers of the axis
Options = dict[str, Any]
GRIDS = (("7%", "49%"), ("63%", "12%"), ("82%", "16%"))
"""Top and height of each chart."""


def force_options() -> Options:
    """Three charts above one another on one time: force at the catheter, force felt, position.

    The script sets the ends of all axes and the data; the series keep this order.
    """
    return {
        "animation": False,
        "grid": [
            {"left": _LEFT_PX, "right": _RIGHT_PX, "top": top, "height": height} for top, height in GRIDS
        ],
        "xAxis": [_time_axis(index) for index in range(3)],
        "yAxis": [_value_axis(index, ticks) for index, ticks in enumerate((5, 2, 3))],
        "series": [
            {"id": "band", "type": "custom", "data": [], "silent": True, "clip": True, "z": 1},
            _line("predicted", 0, _PREDICTED, 2.0),
            _line("measured", 0, _MEASURED, 2.6, "dotted"),
            _line("felt", 1, _FELT, 2.2),
            _line("commanded", 2, _PREDICTED, 1.8),
            _line("readback", 2, _READBACK, 2.0, "dashed"),
        ],
    }


def delay_options() -> Options:
    """The histogram of the round trips."""
    return {
        "animation": False,
        "grid": {"left": 6, "right": 10, "top": 4, "bottom": 20},
        "xAxis": {
            "type": "value",
            "scale": True,
            "splitLine": {"show": False},
            "axisLabel": {"color": _SOFT, "fontSize": 12},
            "axisLine": {"lineStyle": {"color": _SOFT}},
            "splitNumber": 4,
        },
        "yAxis": {"type": "value", "show": False, "min": 0},
        "series": [{"id": "delays", "type": "custom", "data": [], "silent": True, "clip": True}],
    }


def _time_axis(index: int) -> Options:
    return {
        "type": "value",
        "gridIndex": index,
        "min": -20,
        "max": 0,
        "axisLabel": {"show": False},
        "axisTick": {"show": False},
        "splitLine": {"show": False},
        "axisLine": {"onZero": False, "lineStyle": {"color": _RULE}},
    }


def _value_axis(index: int, ticks: int) -> Options:
    return {
        "type": "value",
        "gridIndex": index,
        "min": -1,
        "max": 1,
        "splitNumber": ticks,
        "axisLine": {"show": False},
        "axisTick": {"show": False},
        "axisLabel": {"color": _SOFT, "fontSize": 12.5},
        "splitLine": {"lineStyle": {"color": _RULE}},
    }


def _line(name: str, index: int, colour: str, width: float, kind: str = "solid") -> Options:
    return {
        "id": name,
        "type": "line",
        "xAxisIndex": index,
        "yAxisIndex": index,
        "data": [],
        "showSymbol": False,
        "silent": True,
        "connectNulls": False,
        "lineStyle": {"color": colour, "width": width, "type": kind},
        "itemStyle": {"color": colour},
        "z": 3,
    }
