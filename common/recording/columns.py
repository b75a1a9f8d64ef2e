"""Columns of time, position and force in a table, and their units, by the words that people use."""

import re
from collections.abc import Mapping as NamedUnits
from collections.abc import Sequence
from dataclasses import dataclass
from unicodedata import combining, normalize

from forefeel.common.recording.units import QUANTITIES, TO_SI, Quantity, is_temperature, si_of, unit_of

_ANGLE, _TORQUE = "m?q|angle|theta|winkel", "[a-z]?torque|tau|moment|drehmoment|couple"
_WORDS: dict[Quantity, str] = {
    "time": "(?:sim|sys|run)?times?|t|tout|(?:time)?stamps?|[a-z]*zeit|zeitstempel|x.value|elapsed|temps"
    "|tiempo|tempo|tijd|tid|czas|clock|sec(?:ond)?s?|[mu]s|millis|micros|datetime|时间|時間|время",
    "position": "pos(?:ition|e)?|posicion|posizione|displacement|displ?|stroke|travel|extension|elongation"
    "|depth|indentation|insertion|deflection|compression|dist|distance|crosshead|traverse|course|hub|[a-z]*weg"
    "|verschiebung|deplacement|allongement|desplazamiento|spostamento|deslocamento|verplaatsing"
    f"|przemieszczenie|位移|変位|ストローク|перемещение|tcp|d|[yz]|x(?!.value)|{_ANGLE}",
    "force": "forces?|forc|loads?|weight|gewicht|[a-z]*kraft|kracht|fuerza|forza|forca|carga"
    f"|carico|sila|siła|last|tension|f[xyz]?|loadcell|effort|wrench|力|荷重|試験力|试验力|сила|нагрузка|{_TORQUE}",
}
_OTHER = (
    "index|idx|id|no|nr|num(?:ber)?|frame(?!.time)|samples?(?!.time)|counter|counts?|seq|row|line|cycle|episode|trial|specimen"
    "|(?:min|max)(?:imum)?|sd|std(?:ev)?|sem|sigma|err(?:or)?s?|limits?|threshold|temp(?:erature)?|temperatur"
    "|phase|current|volt(?:s|age)?|power|pressure|stress|strain|stiffness|frequency|resistance|ohms?|humidity"
    "|percent|pct|battery|status|mode|flag|orientation|rotation|quat(?:ernion)?|imu|gyro|mass|area|width|height"
    "|thickness|diameter|radius|raw|adc|encoder|nsecs?"
    r"|pose[\W_]*[3-6]|(?:wrench|tcp[\W_]force)[\W_]*[3-5]"  # a rotation, a torque
)
"""Words of other quantities; beside a word of time, position or force with a unit they say nothing."""
_SETPOINT = (
    "cmd|command(?:ed)?|target|desired|set[ _]?(?:point|pos(?:ition)?|value|force)|demand|ref(?:erence)?|goal"
    "|soll(?:wert)?|action"
)
_PLACES = "motor|laser|axis|stage|slide|carriage|actuator|col(?:umn)?|[abdfhlsxyz]"


def _any_of(words: str) -> re.Pattern[str]:
    """One of them, with no letter beside it."""
    return re.compile(rf"(?<![^\W\d_])(?:{words})(?![^\W\d_])")


_PATTERNS = {quantity: _any_of(words) for quantity, words in _WORDS.items()}
_ROTARY = _any_of(f"{_ANGLE}|[a-z]q|{_TORQUE}")
_DERIVATIVE = _any_of(
    "[a-z]?d{1,2}[qx]|[va] ?[xyz]|vel|velocity|speed|acc|accel|acceleration|dot|twist|rate|jerk"
    "|geschwindigkeit|vitesse|velocidad"
)
"""Speed and acceleration, which are none of the three; `v` and `a` are where they are the whole name."""
_ANOTHER, _WANTED = _any_of(_OTHER), _any_of(_SETPOINT)
_NEUTRAL = re.compile(rf"(?:(?:{_PLACES})(?![^\W\d_])|[\d\W_])+")
_UNWANTED = _any_of("sd|std(?:ev)?|sem|sigma|err(?:or)?s?|(?:min|max)(?:imum)?|limits?|threshold")
_BRACKETED = re.compile(r"[\s_]*[\[(]([^\])]*)[\])]")
_SUFFIXED = re.compile(r"(.*?)(?:_|\s+in\s+|\s*/\s*|\s*,\s*|\s+)([^\s_/,]+)\s*")
_NUMBERED = re.compile(r"\s\d+$")  # of a name that stands twice
_FOREIGN = re.compile(
    r"(?:[pnkKmMuµμG]?(?:[ΩVAWCFHJST]|Hz|Pa|bar|ohms?|volts?|amps?)|psi|[°º]?[CFK]|deg ?[CFK]|celsius|kelvin"
    r"|%|pct|percent|counts?|cts|digits?|lsb|bits?|ticks?|steps?|pulses?|raw|adc|rpm|px|pixels?|dB|.*[/^²³].*)"
)
_JOINT = _any_of("joints?|shoulder|elbow|wrist|gripper|effort")
_GROWN = re.compile(r"([a-z]{2})([A-Z])")
_MASSES = {"gf", "kgf", "lbf"}
_CANONICAL: dict[Quantity, str] = {"time": "time_s", "position": "position_m", "force": "force_n"}


@dataclass(frozen=True, slots=True)
class Choice:
    """A column that may hold the quantity; `unit`: None where nothing states it; `named`: by its name."""

    column: str
    unit: str | None
    named: bool = True


def candidates(names: Sequence[str], units: NamedUnits[str, str], quantity: Quantity) -> list[Choice]:
    """Columns that may hold the quantity: those of the best class that has any. In order: the canonical name,
    such as `time_s`; a word of the quantity and a unit; the word alone; the unit alone; a letter of the
    quantity; a name that says nothing. Left out are derivatives and names of other quantities; setpoints (of
    a force always) and parts along x, y, z where there are others. `units`: of the file, by column.
    """
    canonical = _CANONICAL[quantity]
    if canonical in names:
        return [Choice(canonical, canonical.partition("_")[2].replace("n", "N"))]
    ranked: dict[int, list[Choice]] = {}
    for name in names:
        bare, unit = split_unit(name, quantity)[0], _stated_unit(name, units, quantity)
        plain = _plain(bare)
        word = _PATTERNS[quantity].search(plain)
        doubtful = _ANOTHER if unit is None or word is None else _UNWANTED
        if unit in _MASSES and word is None:
            continue  # grams may be of a flow or of a vibration
        if is_derivative(bare) or doubtful.search(plain) or (quantity == "force" and _WANTED.search(plain)):
            continue
        if unit is None and (
            _states_another(name, units, quantity)
            or (quantity == "position" and _PATTERNS["force"].search(plain))
            or not (word or _NEUTRAL.fullmatch(plain))
        ):
            continue
        letters = len(word[0]) if word else 0
        rank = 0 if word and unit else 1 if letters > 2 else 2 if unit else 3 if word else 4
        ranked.setdefault(rank, []).append(Choice(name, unit, word is not None))
    choices = ranked[min(ranked)] if ranked else []
    choices = [choice for choice in choices if not _WANTED.search(_plain(choice.column))] or choices
    whole = [choice for choice in choices if axis_of(choice.column) not in {"x", "y", "z"}]
    return whole if whole and quantity != "time" else choices  # a load, beside its parts along axes


def _stated_unit(name: str, units: NamedUnits[str, str], quantity: Quantity) -> str | None:
    """Unit of the quantity that the file, or else the name, states, or None. A torque in nm is in N m."""
    unit = unit_of(quantity, units.get(name, "")) or split_unit(name, quantity)[1]
    return None if unit == "nm" and is_rotary(name) else unit


def _states_another(name: str, units: NamedUnits[str, str], quantity: Quantity) -> bool:
    """True if the name or the file states any unit; called for a name without a unit of the quantity."""
    stated = units.get(name, "").strip(" -[]()")
    others = (split_unit(name, other)[1] for other in QUANTITIES if other != quantity)
    return bool(stated) or any(others) or any(_FOREIGN.fullmatch(part.strip()) for part in _parts(name))


def further(names: Sequence[str], units: NamedUnits[str, str]) -> list[tuple[str, str, float]]:
    """(column, SI unit, factor to it) of each that states a unit of length, angle, force, torque or
    temperature (taken for Celsius: no force has to do with its zero), and is no derivative.
    """
    stated = []
    for name in names:
        if is_derivative(name):
            continue
        for quantity in QUANTITIES[1:]:
            unit = _stated_unit(name, units, quantity)
            if unit is not None:
                stated.append((name, si_of(quantity, unit), TO_SI[quantity][unit]))
                break
        else:
            if any(map(is_temperature, (units.get(name, ""), *_parts(name)))):
                stated.append((name, "degC", 1.0))
    return stated


def is_derivative(name: str) -> bool:
    return name.lower() in {"v", "a"} or any(map(_DERIVATIVE.search, (name.lower(), _plain(name))))


def is_rotary(name: str) -> bool:
    """True if it speaks of an angle or a torque."""
    return _ROTARY.search(_plain(name)) is not None


def is_of_a_joint(name: str) -> bool:
    """True if it names a joint or its effort, which may be an angle or a length, a torque or a force."""
    return _JOINT.search(_plain(name)) is not None


def axis_of(name: str) -> str:
    """Letter or number of the axis that a name ends with: z of `Fz (N)` and `tcp_z`, 3 of `tau[3]`; or ""."""
    bare = next((b for quantity in QUANTITIES if (b := split_unit(name, quantity)[0]) != name), name)
    match = re.search(r"(?<![^\W\d_])[a-z]?([xyz])\W*$|(?<=[^\s\d])(\d+)\W*$", _plain(bare))
    return match[1] or match[2] if match else ""


def words_of(name: str) -> set[str]:
    return set(re.findall(r"[^\W_]+", _plain(name)))


def split_unit(name: str, quantity: Quantity) -> tuple[str, str | None]:
    """Name without its unit, and the unit, if it is one of the quantity: (Force, mN) of `Force (mN)`,
    `Force_mN` and `Force / mN`; else the whole name and None. A time named by its unit alone, `millis`,
    keeps the whole name.
    """
    plain = _NUMBERED.sub("", name)
    for match in _BRACKETED.finditer(plain):
        if (unit := unit_of(quantity, match[1])) is not None:
            return f"{plain[: match.start()]} {plain[match.end() :]}".strip(), unit
    suffixed = _SUFFIXED.fullmatch(plain)
    if suffixed is not None and (unit := unit_of(quantity, suffixed[2])) is not None:
        return suffixed[1], unit
    if quantity == "time" and len(plain) > 1 and plain != "min":  # millis
        return name, unit_of(quantity, plain)
    return name, None


def _parts(name: str) -> list[str]:
    """Parts of a name that may be a unit: all texts in brackets, and the last word, which is left out if it
    is a single character other than V, % and Ω.
    """
    plain = _NUMBERED.sub("", name)
    suffix = _SUFFIXED.fullmatch(plain)
    return [
        *_BRACKETED.findall(plain),
        *([suffix[2]] if suffix and (len(suffix[2]) > 1 or suffix[2] in "V%Ω") else []),
    ]


def _plain(name: str) -> str:
    """Name in lower case, without accents, without a title that ends in `: `, camel case apart."""
    text = _GROWN.sub(r"\1 \2", name.rpartition(": ")[2])
    return "".join(letter for letter in normalize("NFKD", text) if not combining(letter)).lower()
