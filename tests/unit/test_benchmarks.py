"""The arithmetic of the benchmarks; what they measure is measured by `make bench`."""

import argparse
import json
from pathlib import Path

import pytest

from benchmarks import __main__ as bench
from benchmarks import headline, lateness, links, reconnect
from benchmarks.gated import command
from benchmarks.markdown import Table
from benchmarks.message_path import __main__ as message_path
from benchmarks.message_path.ends import Stopwatch, summary
from forefeel.report.model import RunReport
from forefeel.report.score import ErrorRatio, PredictionComparison


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
    assert "\nsecond\n" not in out.read_text()


def test_delays_of_a_route_are_a_round_trip_or_both_ways(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    links.add_options(parser, links="default,tls", round_trips="300,200/10")
    asked = links.settings(parser.parse_args(["--losses", "0.1"]))
    assert [setting.cells for setting in asked] == [
        ("default", "300", "0.1"), ("default", "200/10", "0.1"),
        ("tls", "300", "0.1"), ("tls", "200/10", "0.1"),
    ]  # fmt: skip
    assert [setting.route.there.delay_s for setting in asked[:2]] == [0.150, 0.200]
    assert (asked[1].route.back.delay_s, asked[1].route.there.loss) == (0.010, 0.001)
    for words in (
        ["--links", "tsl"],
        ["--round-trips", "8"],
        ["--round-trips", "1/2/3"],
        ["--losses", "100"],
    ):
        with pytest.raises(SystemExit):
            parser.parse_args(words)
        assert f"{words[1]!r}: expected " in capsys.readouterr().err


def test_an_attempt_without_a_session_is_not_within_the_bound() -> None:
    assert reconnect.outcome([1.0, 6.0, None, 2.0], 5.0) == (
        "2 of 4 in 5 s; median 2.0, largest 6.0; 1 without a session"
    )
    assert reconnect.outcome([1.0, 2.0], None) == "median 1.5, largest 2.0"
    assert reconnect.outcome([None], 3.0) == "0 of 1 in 3 s; 1 without a session"


def test_the_headlines_differ_by_the_share_of_the_injected_one() -> None:
    def report(rms: float, settled: float) -> RunReport:
        return RunReport(
            ratio=ErrorRatio(rms=rms), settled=PredictionComparison(ratio=ErrorRatio(rms=settled))
        )

    text = headline.compared([report(0.40, 0.30)], [report(0.42, 0.36), report(0.44, 0.34)])
    assert text == (
        "prediction / hold 0.430 over packets, 0.400 injected: +7.5 %, within 10 %; "
        "settled 0.350 over packets, 0.300 injected: +16.7 %, not within 10 %."
    )


def test_a_table_keeps_in_its_file_what_it_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "table.md"
    table = Table(("link", "stops"), "python -m benchmarks.links", out)
    table.add(("tls", 0))
    printed = capsys.readouterr().out
    assert printed == "| link | stops |\n|---|---|\n| tls | 0 |\n"
    assert out.read_text().endswith(f"\n\n{printed}")
    assert out.read_text().startswith("`python -m benchmarks.links` (as root), ")
