"""The hash chain: what is changed, taken out, put in or moved is found at its line; a cut tail by a head."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.events.audit import GENESIS, ChainEnd, Noted, Verdict, is_hash, parse, seal, verify

TEXTS = st.text(st.characters(codec="utf-8"), max_size=20)
DETAILS = st.dictionaries(
    TEXTS, st.one_of(TEXTS, st.integers(), st.booleans(), st.none(), st.floats(allow_nan=False))
)


def log(count: int = 6, after: ChainEnd = ChainEnd(), first: str = "start") -> list[bytes]:  # noqa: B008 - a tuple
    lines = []
    for number in range(count):
        event = "stop" if number == count - 1 else "safety" if number else first
        noted = Noted(f"2026-01-01T00:00:0{number}.000000Z", number * 1000, event, "a", {"n": number})
        line, after = seal(noted, after)
        lines.append(line)
    return lines


def at(verdict: Verdict) -> int:
    assert verdict.flaw is not None
    return verdict.flaw.line


def test_a_log_as_it_was_written_is_intact_and_closed() -> None:
    verdict = verify(log())
    assert (verdict.entries, verdict.intact, verdict.closed, verdict.torn) == (6, True, True, 0)
    assert verdict.first is not None and verdict.last is not None
    assert (verdict.first.number, verdict.last.number, verdict.first.previous) == (1, 6, GENESIS)
    assert verify([]).entries == 0


@given(st.data())
def test_no_byte_of_any_line_can_be_changed_unseen(data: st.DataObject) -> None:
    lines = log()
    number = data.draw(st.integers(0, len(lines) - 1))
    line = bytearray(lines[number])
    place = data.draw(st.integers(0, len(line) - 2))
    line[place] ^= data.draw(st.integers(1, 255))
    lines[number] = bytes(line)
    changed = verify(lines)
    if changed.torn:  # the byte became the end of a line, and the rest of it no entry
        assert changed.entries == number
    else:
        assert at(changed) == number + 1


def test_what_is_taken_out_put_in_or_moved_is_found_at_its_line() -> None:
    lines = log()
    assert at(verify(lines[1:])) == 1
    assert at(verify([*lines[:2], *lines[3:]])) == 3
    assert at(verify([lines[0], lines[2], lines[1], *lines[3:]])) == 2
    assert at(verify([*lines[:3], lines[2], *lines[3:]])) == 4
    assert at(verify([*lines, log(1)[0]])) == 7


def test_an_entry_that_is_made_anew_breaks_the_chain_behind_it() -> None:
    lines = log()
    second = parse(lines[1][:-1])
    forged, _ = seal(second.noted._replace(details={"n": 99}), ChainEnd(1, second.previous))
    assert verify([lines[0], forged]).intact  # so far it can not be told
    assert at(verify([lines[0], forged, *lines[2:]])) == 3


def test_a_key_that_stands_twice_is_no_entry_though_its_hash_fits() -> None:
    line = log(1)[0]
    twice = line.replace(b'"event":"stop"', b'"event":"start","event":"stop"')
    assert json.loads(twice)["event"] == "stop"
    assert at(verify([twice])) == 1


@pytest.mark.parametrize("line", [b"\n", b"{}\n", b"[]\n", b"null\n", b"\xff\xfe\n", b'{"a":' * 2000 + b"\n"])
def test_what_is_no_entry_is_said_and_raises_nothing_else(line: bytes) -> None:
    assert at(verify([*log(2)[:1], line])) == 2


def test_a_cut_tail_is_not_closed_and_a_head_that_was_noted_finds_it() -> None:
    lines = log()
    last = parse(lines[-1][:-1]).hash
    cut = verify(lines[:4], last)
    assert (cut.intact, cut.closed, cut.head_at) == (True, False, None)
    assert verify(lines, last).head_at == 6
    assert verify(lines, parse(lines[2][:-1]).hash).head_at == 3


def test_half_a_last_line_is_no_flaw_but_said() -> None:
    lines = log()
    verdict = verify([*lines[:5], lines[5][:40]])
    assert (verdict.entries, verdict.intact, verdict.closed, verdict.torn) == (5, True, False, 40)


def test_a_file_that_goes_on_with_another_is_intact_and_says_which_hash_it_follows() -> None:
    first = log(3)
    end = parse(first[-1][:-1])
    verdict = verify(log(3, ChainEnd(end.number, end.hash), "continued"))
    assert verdict.intact and verdict.first is not None
    assert (verdict.first.number, verdict.first.previous) == (4, end.hash)


@given(TEXTS, TEXTS, st.integers(), DETAILS)
def test_whatever_is_noted_is_read_back(event: str, axis: str, stamp: int, details: dict[str, str]) -> None:
    noted = Noted("2026-01-01T00:00:00.000000Z", stamp, event, axis, details)
    line, end = seal(noted, ChainEnd())
    assert line.count(b"\n") == 1 and line.isascii()
    entry = parse(line[:-1])
    assert (entry.noted, entry.number, entry.hash) == (noted, 1, end.hash)
    assert is_hash(entry.hash)
    assert not is_hash(entry.hash[1:]) and not is_hash("g" * 64)
