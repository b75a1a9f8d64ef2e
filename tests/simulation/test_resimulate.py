"""A recorded session, predicted anew: the same bits from the same version, and where a version differs."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forefeel.common.estimation import blend
from forefeel.common.estimation.contact_prior import exactly
from forefeel.common.messages import HapticSample, Message, ModelParameters
from forefeel.common.prior_file import keep_prior
from forefeel.common.recording.mcap_reader import Run as RecordedRun
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, MASTER_HANDSHAKE, PARAMETERS, Topic
from forefeel.loopback.plan import PRIOR, LoopbackOptions, make_plan
from forefeel.report.summary import summarise
from tests.looped import looped

Run = Callable[[Sequence[str]], int]
Messages = list[tuple[str, Message, int]]
KNOWN = {"contact_loss.contact_position_m": 0.012, "mass_damper_spring.stiffness_n_m": 9.0}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Messages, dict[str, str]]:
    """Messages and metadata of 4 s over the paper's network, which loses 1 %, with a prior."""
    priors = tmp_path_factory.mktemp("priors")
    keep_prior(priors, "catheter", "simulated", exactly(KNOWN), date(2026, 1, 1))
    plan = make_plan(LoopbackOptions(impairment="paper", duration_s=4.0, prior_dir=priors))
    return looped(plan, 0).messages, plan.recorded()


def of(messages: Messages, topic: Topic[Any]) -> list[Any]:
    return [message for key, message, _ in messages if key.endswith(topic.name)]


def written(path: Path, messages: Messages, metadata: dict[str, str]) -> str:
    with RunWriter(path) as writer:
        writer.add_metadata("run", metadata)
        for key, message, stamp_ns in messages:
            writer.write_message(key, message, stamp_ns)
    return str(path)


@pytest.fixture
def recording(session: tuple[Messages, dict[str, str]], tmp_path: Path) -> str:
    return written(tmp_path / "run.mcap", *session)


def test_a_session_with_loss_and_a_prior_is_repeated_bit_for_bit(
    run: Run, capsys: pytest.CaptureFixture[str], session: tuple[Messages, dict[str, str]], recording: str
) -> None:
    messages, _ = session
    taken = [sequence for sample in of(messages, HAPTICS) for sequence in sample.forces]
    assert len(taken) > 3000
    assert len(set(range(taken[-1])) - set(taken)) > 10  # lost on the way
    assert of(messages, PARAMETERS)[-1].prior.startswith("catheter, patient simulated")
    assert run(["resimulate", recording, "--require-identical", "--no-worse", "1", "--json"]) == 0
    (compared,) = json.loads(capsys.readouterr().out)["sessions"]
    assert (compared["identical"], compared["ratio"], compared["lost"]) == (1.0, 1.0, 0)
    assert compared["commands"] == len(of(messages, HAPTICS))
    report = summarise(RecordedRun(Path(recording)))
    assert compared["now"]["error"] == compared["recorded"]["error"] == asdict(report.prediction)
    assert compared["now"]["coverage_95"] == report.predictor.coverage_95


def test_a_constant_that_changes_by_a_hundredth_shows(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, recording: str
) -> None:
    begin = blend.begin

    def changed(values: np.void, taught: bool) -> None:
        begin(values, taught)
        values["persistence"] = 0.99

    monkeypatch.setattr(blend, "begin", changed)
    assert run(["resimulate", recording, "--require-identical"]) == 1
    shown = capsys.readouterr()
    assert "expected all" in shown.err
    (row,) = (line for line in shown.out.splitlines() if "difference of the two" in line)
    assert row.split("|")[2].strip() != "0 N"
    assert "100 %" not in shown.out


def test_a_session_that_is_worse_fails(run: Run, capsys: pytest.CaptureFixture[str], recording: str) -> None:
    assert run(["resimulate", recording, "--no-worse", "0.99"]) == 1
    assert "rms now / then 1, expected at most 0.99" in capsys.readouterr().err


def without(messages: Messages, topic: Topic[Any], first: int) -> Messages:
    """The messages but those of the topic, or but the first so many of them."""
    rows = [i for i, (key, _, _) in enumerate(messages) if key.endswith(topic.name)][:first]
    return [entry for i, entry in enumerate(messages) if i not in set(rows)]


def changed(messages: Messages, kind: type[Message], **fields: object) -> Messages:
    return [(key, m.model_copy(update=fields) if isinstance(m, kind) else m, at) for key, m, at in messages]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda m, r: (without(m, HAPTICS, 10**6), r), "no session"),
        (lambda m, r: (changed(m, HapticSample, protocol=6, snapshot=None), r), "protocol 6"),
        (lambda m, r: (without(m, HAPTICS, 7), r), "begins at command 8"),
        (lambda m, r: (m + [(key, message, at + 10**10) for key, message, at in m], r), "holds two masters"),
        (lambda m, r: (without(m, MASTER_HANDSHAKE, 10**6), r), "no handshake"),
        (lambda m, r: (m, {name: r[name] for name in r if name != PRIOR}), "the prior it started from"),
        (lambda m, r: (changed(m, ModelParameters, model=("hysteresis",)), r), "predicts with (hysteresis)"),
        (lambda m, r: (m, r | {PRIOR: "{}"}), "limits, prior or model are damaged"),
        (lambda m, r: (without(m, FORCE, 10**6), r), "nothing to compare"),
    ],
)
def test_what_can_not_be_resimulated_is_refused_in_one_line(
    run: Run,
    capsys: pytest.CaptureFixture[str],
    session: tuple[Messages, dict[str, str]],
    tmp_path: Path,
    damage: Callable[[Messages, dict[str, str]], tuple[Messages, dict[str, str]]],
    words: str,
) -> None:
    messages, metadata = session
    end_ns = messages[0][2] + 2_000_000_000
    short = [entry for entry in messages if entry[2] < end_ns]
    assert run(["resimulate", written(tmp_path / "run.mcap", *damage(short, metadata))]) == 2
    shown = capsys.readouterr()
    assert (shown.out, shown.err.count("\n")) == ("", 1)
    assert words in shown.err


def test_what_the_recorder_lost_is_counted(
    run: Run, capsys: pytest.CaptureFixture[str], session: tuple[Messages, dict[str, str]], tmp_path: Path
) -> None:
    messages, metadata = session
    some = without(without(messages, COMMAND, 3), FORCE, 100)
    path = written(tmp_path / "run.mcap", some, metadata)
    taken = {sequence for sample in of(messages, HAPTICS) for sequence in sample.forces}
    assert run(["resimulate", path, "--json"]) == 0
    (compared,) = json.loads(capsys.readouterr().out)["sessions"]
    missing = {m.sequence for m in of(messages, FORCE)} - {m.sequence for m in of(some, FORCE)}
    assert compared["lost"] == 3 + len(taken & missing)


@pytest.mark.parametrize("name", ["catheter_300ms", "coronary_300ms", "guidewire_100ms"])
def test_recorded_sessions_are_predicted_no_worse(run: Run, name: str) -> None:
    path = Path(__file__).parents[1] / "data" / f"{name}.mcap"
    assert run(["resimulate", str(path), "--no-worse", "1.02"]) == 0
