"""The arithmetic of the benchmarks; what they measure is measured by `make bench`."""

import json
from pathlib import Path

import pytest

from benchmarks import __main__ as bench
from benchmarks import lateness
from benchmarks.gated import command
from benchmarks.message_path import __main__ as message_path
from benchmarks.message_path.ends import Stopwatch, summary


def test_a_quantile_of_whole_microseconds_is_in_the_middle_of_its_own() -> None:
    assert lateness.quantiles({10: 500, 20: 490, 40: 9, 7: 1}) == (10.5, 20.5, 40.5)


def test_the_ratio_is_the_median_of_those_of_the_rounds() -> None:
    rounds = [
        {"cyclictest": (1.0, p99, p99), "slave": (2.0, ratio * p99, 9.0)}
        for p99, ratio in ((10.0, 2.0), (100.0, 3.0), (1000.0, 9.0))
    ]
    reference, slave = lateness.table("quiet", rounds)
    assert (reference["ratio_p99"], slave["ratio_p99"], slave["p99_us"]) == (1.0, 3.0, 300.0)
    assert "quiet" in lateness.text([reference, slave])


def test_an_answer_is_its_question_and_a_lost_one_delays_no_other() -> None:
    watch = Stopwatch()
    lost, heard = watch.ask(), watch.ask()
    watch.answered(heard)
    watch.answered(heard)
    watch.answered(b"of nobody")
    assert (len(watch.times_us), watch.open) == (1, 1)
    assert lost != heard
    assert command(7) != command(8)


def test_a_way_is_compared_with_bare_zenoh_of_the_same_round() -> None:
    found = {"BareZenoh": [(100.0, 1.0, 1.0, 0), (200.0, 1.0, 1.0, 0)],
             "Own": [(150.0, 1.0, 1.0, 2), (200.0, 1.0, 1.0, 1)]}  # fmt: skip
    bare, own = message_path.table(found)
    assert (bare["ratio"], own["ratio"], own["lost"]) == (1.0, 1.25, 3)
    assert "missing: no library" in message_path.text([bare, own], {"Grpc": "no library"})


def test_the_summary_orders_its_quantiles() -> None:
    p50, p99, p999 = summary([float(each) for each in range(1001)])
    assert (p50, p99, p999) == pytest.approx((500.0, 990.0, 999.0))


def _bench(monkeypatch: pytest.MonkeyPatch, out: Path, said: str, *words: str) -> str:
    """The page after a run in which each part printed `said`."""
    monkeypatch.setattr(bench, "_install", lambda: None)
    monkeypatch.setattr(
        bench,
        "_run",
        lambda each: bench.Part(each.module, each.question, "2026-11-22", "abc", 1.0, 0, [said], None),
    )
    monkeypatch.setattr("sys.argv", ["bench", "--out", str(out), *words])
    assert bench.main() == 0
    return out.read_text()


def test_a_part_that_is_run_again_leaves_the_others_as_they_were(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    out = tmp_path / "RESULTS.md"
    whole = _bench(monkeypatch, out, "first")
    assert whole.count("\nfirst\n") == len(bench.ALL)
    again = _bench(monkeypatch, out, "second", "--only", "lateness")
    assert (again.count("\nfirst\n"), again.count("\nsecond\n")) == (len(bench.ALL) - 1, 1)
    assert again.index("benchmarks.message_path") < again.index("second") < again.index("benchmarks.cells")
    assert _bench(monkeypatch, out, "third").count("\nthird\n") == len(bench.ALL)


def test_parts_of_another_machine_are_not_mixed_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    out = tmp_path / "RESULTS.md"
    _bench(monkeypatch, out, "first")
    found = json.loads(out.with_suffix(".json").read_text())
    out.with_suffix(".json").write_text(json.dumps({**found, "machine": {"model": "another"}}))
    with pytest.raises(SystemExit, match="of another machine or other versions; expected another --out"):
        _bench(monkeypatch, out, "second", "--only", "lateness")
    assert "second" not in out.read_text()
