"""What `forefeel demo` says at its end; its runs and its diagnosis are tested where they are."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from forefeel import demo
from forefeel.common.error_size import ErrorSize
from forefeel.common.errors import ConfigurationError
from forefeel.dashboard.scene import Scene
from forefeel.loopback.plan import LoopbackOptions
from forefeel.report.transparency import Transparency


def run(felt_n: float, held_n: float) -> SimpleNamespace:
    score = Transparency(100, ErrorSize(felt_n), ErrorSize(held_n), felt_n / held_n, 0.5, 0.9)
    delay_s = SimpleNamespace(p50=0.3)
    return SimpleNamespace(transparency=score, transparency_as_measured=score, delay_s=delay_s)


class Viewer:
    url, until = "http://127.0.0.1:8600/", "Ctrl-C"

    def __init__(self) -> None:
        self.scenes: list[Scene] = []

    def show(self, scene: Scene) -> None:
        self.scenes.append(scene)

    def stay(self, felt: str, recording: Path, pages: dict[str, Path]) -> None:
        self.scenes.append(Scene(head=felt, recording=recording, pages=pages))


@pytest.mark.parametrize("causes", [(), ("capstan",), ("capstan", "asymmetric_damping"), (*demo.HIDDEN,)])
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

    def recorded_run(options: LoopbackOptions, *_: object, **__: object) -> SimpleNamespace:
        asked.append(options)
        return next(runs)

    monkeypatch.setattr(demo, "recorded_run", recorded_run)
    monkeypatch.setattr(demo, "judge", lambda _: None)
    monkeypatch.setattr(demo, "_diagnose", lambda *_: found)
    viewer = Viewer()
    demo.run_demo(viewer, tmp_path, 1)  # type: ignore[arg-type]
    named = [name for name in causes if name in demo.HIDDEN]
    assert [options.master_model is not None for options in asked] == [False, bool(named)]
    assert (asked[1].prior_dir is None) == bool(named)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 10
    assert all(name in lines[1] for name in demo.HIDDEN)
    assert ("all of it" in lines[2], "1 of 2" in lines[2]) == (len(named) == 2, len(named) == 1)
    assert all(each in lines[-1] for each in ("91 mN", "33 mN", "14 mN", "0.15"))
    assert viewer.scenes[-1].head in lines[-1]
    shown = [(each.recording and each.recording.parent.name, len(each.pages)) for each in viewer.scenes]
    assert shown == [(None, 0), ("first", 1), (None, 2), (tmp_path.name, 3)]


@pytest.mark.parametrize("name", ["slave.yaml", "vessel.yaml", "prior"])
def test_what_no_demo_has_made_stays(name: str, tmp_path: Path) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(ConfigurationError, match="no demo"):
        demo.run_demo(Viewer(), tmp_path, 1)  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == [name]
