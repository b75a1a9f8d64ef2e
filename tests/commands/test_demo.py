"""What `forefeel demo` says at its end; its runs and its diagnosis are tested where they are."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from forefeel import demo
from forefeel.common.error_size import ErrorSize
from forefeel.loopback.plan import LoopbackOptions
from forefeel.report.transparency import Transparency


def run(felt_n: float, held_n: float) -> SimpleNamespace:
    score = Transparency(100, ErrorSize(felt_n), ErrorSize(held_n), felt_n / held_n, 0.5, 0.9)
    return SimpleNamespace(transparency=score, delay_s=SimpleNamespace(p50=0.3))


@pytest.mark.parametrize("causes", [(), ("capstan",), ("capstan", demo.HIDDEN)])
def test_demo_tells_what_was_hidden_and_ends_with_the_errors(
    causes: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    runs = iter([run(0.033, 0.089), run(0.014, 0.091)])
    found = SimpleNamespace(
        verdict="cause_found", causes=[SimpleNamespace(name=name, parameters={}) for name in causes]
    )
    asked: list[LoopbackOptions] = []

    def recorded_run(options: LoopbackOptions, *_: object) -> SimpleNamespace:
        asked.append(options)
        return next(runs)

    monkeypatch.setattr(demo, "recorded_run", recorded_run)
    monkeypatch.setattr(demo, "judge", lambda _: None)
    monkeypatch.setattr(demo, "_diagnosed", lambda *_: found)
    demo.run_demo(tmp_path, 1, 0, opens=False)
    assert [options.master_model is not None for options in asked] == [False, demo.HIDDEN in causes]
    assert (asked[1].prior_dir is None) == (demo.HIDDEN in causes)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 10
    assert (demo.HIDDEN in causes) == ("names what was hidden" in lines[1])
    assert demo.HIDDEN in lines[1]
    assert all(each in lines[-1] for each in ("89 mN", "33 mN", "14 mN", "0.15"))
