"""The page as NiceGUI builds it: what stands where. What it shows comes with the conversation (page.js).

Texts that come from the network are set by the script as text, never as HTML.
"""

from pathlib import Path

from nicegui import app, ui
from nicegui.elements.mixins.text_element import TextElement

from forefeel.dashboard.charts import GRIDS, delay_options, force_options
from forefeel.report.wording import DISCLAIMER

STATIC = "/forefeel"
_HERE = Path(__file__).parent
_HEAD = f"""
<link rel="stylesheet" href="{STATIC}/page.css">
<script type="module" src="{STATIC}/page.js"></script>
"""
_KEYS = (
    ("Space", "pause, and go on (a recording: play)"),
    ("+  −", "less time, or more of it"),
    ("←  →", "while paused back and forth; in a recording by 1 s, with Shift by 10 s"),
    ("Home  End", "begin and end of a recording"),
    ("a", "the next axis"),
    ("?", "these keys"),
)


def serve_files() -> None:
    """Style and script, asked for anew with every load."""
    app.add_static_files(STATIC, _HERE / "static", max_cache_age=0)


def build() -> None:
    ui.add_head_html(_HEAD)
    with _box("ff"):
        _head()
        with _box("ff-main"):
            with _box("ff-left"):
                _figures()
                _charts()
                with _box("ff-below"):
                    _events()
                    _counters()
            with _box("ff-right"):
                _watch()
                _delay()
                _model()
                _energy()
                _loops()
        _foot()
        _help()


def _box(classes: str = "", tag: str = "div", props: str = "") -> ui.element:
    return ui.element(tag).classes(classes).props(props)


def _text(text: str = "", tag: str = "span", classes: str = "", field: str = "") -> ui.element:
    found = TextElement(tag=tag, text=text).classes(classes)
    return found.props(f'data-field="{field}"' if field else "")


def _card(title: str, classes: str = "", mark: str = "") -> ui.element:
    found = _box(f"ff-card {classes}", "section", mark)
    with found:
        _text(title, "h2")
    return found


def _head() -> None:
    with _box("ff-head", "header"):
        with _box("ff-who"):
            _text("forefeel")
            _text(tag="b", field="cell")
        _box("", "select", 'data-id="axis" aria-label="axis"')
        _box("ff-lights", props='data-id="lights" role="status"')
        with _box("ff-buttons"):
            for name, label, sign in (("pause", "pause", "❚❚"), ("nearer", "zoom in", "+"),
                                      ("farther", "zoom out", "−"), ("keys", "keys", "?")):  # fmt: skip
                _button(name, label, sign)


def _button(name: str, label: str, sign: str) -> None:
    _text(sign, "button").props(f'data-id="{name}" aria-label="{label}" title="{label}" type="button"')


def _figures() -> None:
    with _box("ff-figures"):
        for name, title, unit, line, more in (
            ("felt", "felt by the hand", "N", "", "limited"),
            ("predicted", "predicted", "N", "", "band"),
            ("measured", "measured, late", "N", "dotted", "age"),
            ("delay", "delay, round trip", "ms", "none", "leading"),
        ):
            with _box(f"ff-card ff-figure {name}", "section"):
                with _box("name"):
                    _box(line, "i")
                    _text(title)
                with _box("value"):
                    _text("–", field=name)
                    _text(unit, "small")
                _box("more", props=f'data-field="{more}"')


def _charts() -> None:
    with _box("ff-card ff-charts", "section", 'data-id="charts"'):
        with _box("ff-plots"):
            ui.echart(force_options()).classes("plot").props('data-id="force"')
            _text("force at the catheter, N: each at the command that it belongs to").style("top: 0")
            _text("force felt by the hand, N").style(f"top: calc({GRIDS[1][0]} - 19px)")
            with _box("", "span").style(f"top: calc({GRIDS[2][0]} - 19px)"):
                _text("position, mm:")
                for name, kind in ("commanded", "c1"), ("readback", "c2"):
                    _text("read back" if name == "readback" else name, "em", kind)
                    _text(tag="em", classes=f"{kind} figure", field=name)
        _box("ff-ticks", props='data-id="ticks" aria-hidden="true"')
        with _box("ff-silence", props='data-id="silence" hidden role="alert"'):
            for tag, field in (("b", "silence"), ("span", "silence-since"), ("span", "silence-where")):
                _text(tag=tag, field=field)
        _text("paused", classes="ff-paused").props('data-id="paused" hidden')


def _events() -> None:
    with _card("events", "ff-listed"), _box("ff-scroll"), _box("", "table"):
        _box("", "tbody", 'data-id="events"')


def _counters() -> None:
    with _card("counted by both ends", "ff-listed"):
        _box("ff-sums", props='data-id="sums"')
        with _box("ff-scroll"), _box("", "table"):
            _box("", "tbody", 'data-id="counters"')


def _watch() -> None:
    with _card("live diagnosis", "ff-watch off", 'data-id="watch" role="status"'):
        with _box("word"):
            _box("mark", "span")
            _text(field="watch-word")
        for field in ("watch-since", "watch-signs"):
            _text(tag="p", field=field)
        _text(tag="p", classes="headline", field="watch-headline")
        _box("", "ul", 'data-id="causes"')


def _delay() -> None:
    with _card("delay of the last minute, ms", "ff-delay"):
        ui.echart(delay_options()).classes("plot").props('data-id="delays"')
        _text(tag="p", field="delay-words")


def _model() -> None:
    with _card("contact model", "ff-model"):
        with _box("", "table"):
            _box("", "tbody", 'data-id="parameters"')
        for field in ("statements", "model-foot"):
            _text(tag="p", field=field)


def _energy() -> None:
    with _card("energy that the hand has put in"), _box("ff-line"):
        _text(classes="value", field="energy")
        _text(field="energy-words")


def _loops() -> None:
    with _card("lateness of the 1 kHz loops"), _box("", "table"):
        _box("", "tbody", 'data-id="loops"')


def _foot() -> None:
    with _box("ff-foot", "footer"):
        _text(DISCLAIMER, "b")
        with _box("room", props='data-id="player" hidden').style("display: flex; gap: 10px"):
            _button("play", "play and pause", "▶")
            _box(
                "",
                "input",
                'data-id="slider" type="range" min="0" max="1" step="0.001" value="0" aria-label="time"',
            )
            _text(classes="time", field="place")
        _text(classes="room", field="about")
        _text(classes="ff-lost", field="connection").props('data-id="connection" role="alert"')


def _help() -> None:
    with _box("", "dialog", 'data-id="help" aria-label="keys"'):
        with _box("", "table"), _box("", "tbody"):
            for keys, what in _KEYS:
                with _box("", "tr"):
                    with _box("", "td"):
                        _text(keys, "kbd")
                    _text(what, "td")
        _text(
            "Nothing is commanded from here. To stop: the handle's button, the slave, or forefeel estop.",
            "p",
        )
