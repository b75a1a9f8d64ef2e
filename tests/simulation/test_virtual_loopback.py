"""The whole system in virtual time: both daemons, codec, gates, impairment, operator and world."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.hidden_in_service import write_model
from forefeel.common.codec import Codec
from forefeel.common.config import deep_merge
from forefeel.common.messages import Grip
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.recording.recording import Recording
from forefeel.common.topics import (
    COMMAND,
    FORCE,
    HAPTICS,
    MASTER_HANDSHAKE,
    MASTER_STATE,
    PARAMETERS,
    SLAVE_HANDSHAKE,
    SLAVE_STATE,
    Topic,
)
from forefeel.common.transport.settings import PRESETS
from forefeel.loopback.plan import LoopbackOptions, Plan, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.page import write_report
from forefeel.report.traces import axis_traces
from forefeel.report.transparency import against_twin, as_measured
from tests.looped import looped
from tests.network import M, S, Traffic, traffic_of

TICK_S = 0.001
WATCHDOG_S = 0.060


def write_csv(path: Path, names: str, columns: Sequence[NDArray[np.float64]]) -> Path:
    np.savetxt(path, np.column_stack(list(columns)), fmt="%.9f", delimiter=",", header=names, comments="")
    return path


def run_plan(plan: Plan, seed: int = 1) -> Traffic:
    loop = VirtualLoopback(plan, seed, Codec)
    loop.run(lambda _done_s: None)
    return traffic_of(loop)


def run_with(**options: Any) -> Traffic:  # noqa: ANN401 - the fields of LoopbackOptions
    seed = options.setdefault("seed", 1)
    return run_plan(make_plan(LoopbackOptions(**options)), seed)


IMPAIRMENTS_S = {"none": 3.0, "lte": 3.0, "paper": 7.0}
"""Length of a run with each."""


@cache
def run_over(impairment: str) -> Traffic:
    return run_with(impairment=impairment, duration_s=IMPAIRMENTS_S[impairment])


@pytest.fixture(params=IMPAIRMENTS_S)
def impaired(request: pytest.FixtureRequest) -> tuple[str, Traffic]:
    return request.param, run_over(request.param)


def test_one_seed_repeats_bit_for_bit_and_another_differs() -> None:
    first, again, other = (
        run_with(impairment="paper", duration_s=2.0, seed=seed).payloads for seed in (7, 7, 8)
    )
    assert first == again
    assert first != other
    assert len(first) > 4000


def test_every_impairment_arms_and_stays_armed(impaired: tuple[str, Traffic]) -> None:
    impairment, traffic = impaired
    assert [event for _, event in traffic.events()][-2:] == ["release", "at_rest"]  # told to, at the end
    assert traffic.messages(SLAVE_STATE)[-1].stops == 0
    assert traffic.times("engaged")[0] < 1.0 + 2.0  # the run starts at 1 s
    assert traffic.armed_share(until_s=1.0 + IMPAIRMENTS_S[impairment]) > 0.99


def test_a_force_answers_the_command_that_the_stage_followed(impaired: tuple[str, Traffic]) -> None:
    traffic, link = impaired[1], PRESETS[impaired[0]]
    sent = {command.sequence: command for command in traffic.messages(COMMAND)}
    answers = [sample for sample in traffic.messages(FORCE) if sample.answers_sequence is not None]
    assert len(answers) > 1000
    for sample in answers:
        command = sent[sample.answers_sequence or 0]
        assert command.session_id == sample.session_id
        age_s = (sample.stamp_ns - command.stamp_ns) / S
        assert link.delay_s - link.jitter_s < age_s < link.delay_s + link.jitter_s + WATCHDOG_S
    executed = [sample.answers_sequence or 0 for sample in answers]
    assert executed == sorted(executed)
    for haptic in traffic.messages(HAPTICS):
        if haptic.delay_s is not None:
            sent_ns = sent[haptic.answered_sequence or 0].stamp_ns
            evened_ns = 20e6  # by which a command may be early or late for its motion
            assert 0 <= haptic.delay_s * S <= haptic.stamp_ns - sent_ns + evened_ns
    delay_s = np.nanmedian(traffic.column(HAPTICS, "delay_s"))
    assert delay_s == pytest.approx(2 * link.delay_s, abs=2 * link.jitter_s + 3 * TICK_S)

    samples = [sample for sample in answers if sample.answers_stamp_ns]
    behind_ns = np.array([sample.stamp_ns - (sample.answers_stamp_ns or 0) for sample in samples])
    mean_ns = 1e9 * link.delay_s
    assert abs(np.median(behind_ns) - mean_ns) < 0.1 * mean_ns + 2e6  # a tick at either end
    assert np.quantile(np.abs(np.diff(behind_ns)), 0.99) < 0.1e6  # no jitter of the commands


def test_the_hand_feels_no_jump_and_no_nonsense(impaired: tuple[str, Traffic]) -> None:
    impairment, traffic = impaired
    rendered_n = traffic.column(HAPTICS, "rendered_n")
    time_s = traffic.column(HAPTICS, "stamp_ns") / S
    assert np.isfinite(rendered_n).all()
    assert np.abs(rendered_n).max() <= 4.0
    running = time_s < 1.0 + IMPAIRMENTS_S[impairment]  # at its end the force is taken away at once
    assert np.abs(np.diff(rendered_n[running], prepend=0.0)).max() <= 80.0 * TICK_S + 1e-9
    before = time_s < traffic.times("engage")[0]
    assert before.any()
    assert not rendered_n[before].any()


def test_report_scores_prediction_and_felt_force(tmp_path: Path) -> None:
    plan = make_plan(LoopbackOptions(seed=1, impairment="paper", duration_s=IMPAIRMENTS_S["paper"]))
    with RunWriter(tmp_path / "run.mcap") as writer:
        writer.add_metadata("run", plan.recorded())
        for key, payload, stamp_ns in run_over("paper").payloads:
            writer.write(key, payload, stamp_ns)
    report = write_report(tmp_path / "run.mcap", tmp_path)
    assert report.settled.commands > 1500 and (report.settled.ratio or 9.0) < 0.6
    assert report.transparency is not None and (report.transparency.ratio or 9.0) < 0.9
    offset_s, held_offset_s = report.transparency.offset_s, report.transparency.held_offset_s
    assert offset_s is not None and abs(offset_s) < 0.1
    assert held_offset_s == pytest.approx(report.delay_s.p50, abs=0.02)
    assert "twin of the simulated world" in (tmp_path / "report.html").read_text()
    run = Run(tmp_path / "run.mcap")
    commands = axis_traces(run, "insertion").commands
    perfect = replace(commands, rendered_n=commands.force_n)
    twin, measured = (of(run, "insertion", perfect) for of in (against_twin, as_measured))
    assert twin is not None and (twin.felt.rms_n or 9.0) < 0.008  # 2 mN of noise, and the jitter
    assert measured is not None and measured.felt.max_n == 0.0 and measured.offset_s == pytest.approx(0.0)
    assert measured.held_offset_s == pytest.approx(report.delay_s.p50, abs=0.02)


@pytest.mark.parametrize(("preset", "limit_n"), [("catheter", 3.0), ("guidewire", 0.3)])
def test_each_simulated_instrument_has_a_force_limit_of_its_own_on_both_ends(
    tmp_path: Path, preset: str, limit_n: float
) -> None:
    path = write_csv(tmp_path / "run.csv", "time_s,position_m", [GAPPED_S, 0.005 * np.sin(GAPPED_S)])
    plan = make_plan(LoopbackOptions(preset=preset, recording=path))
    (slave,), (master,) = plan.slave_settings().axes, plan.master_settings().axes
    assert slave.limits == master.limits
    assert slave.limits.max_force_n == limit_n


GAPPED_S = np.concatenate([np.arange(0.0, 1.2, 0.01), np.arange(1.7, 2.7, 0.01)])


def gapped(path: Path, sign: int) -> Path:
    """Two pieces with a gap of half a second and a jump of 9 mm between them; the force of a damper, with
    what else there is, by its sign resisting or driving.
    """
    after = GAPPED_S > 1.5
    position_m = 0.005 * np.sin(4.0 * GAPPED_S) + 0.009 * after
    force_n = sign * (0.5 * np.cos(4.0 * GAPPED_S) + 0.2 * np.cos(37.0 * GAPPED_S) + after)
    return write_csv(path, "time_s,position_m,force_n", [GAPPED_S, position_m, force_n])


def resisting(recording: Recording) -> float:
    """1, or -1 for a force that gives energy to the motion as it was recorded."""
    assert recording.force_n is not None
    pieces = recording.segments()
    work_j = sum(np.trapezoid(recording.force_n[piece], recording.position_m[piece]) for piece in pieces)
    return float(np.sign(work_j))


def replayed(traffic: Traffic, topic: Topic[M]) -> tuple[list[M], NDArray[np.float64]]:
    """Messages that belong to an instant of the recording, and that in s."""
    messages, time_s = traffic.messages(topic), traffic.column(topic, "recording_time_s")
    rows = np.flatnonzero(~np.isnan(time_s))
    assert len(rows) > 1000
    return [messages[row] for row in rows], time_s[rows]


def check_playback(traffic: Traffic, recording: Recording) -> None:
    """Commands are where the recording was, forces are those of that moment, nothing comes from a gap."""
    pieces = recording.segments()
    starts_s = np.array([recording.time_s[piece.start] for piece in pieces])
    ends_s = np.array([recording.time_s[piece.stop - 1] for piece in pieces])
    played, at_s = replayed(traffic, COMMAND)
    assert ((starts_s <= at_s[:, None]) & (at_s[:, None] <= ends_s)).any(axis=1).all()
    expected_m = np.interp(at_s, recording.time_s, recording.position_m)
    np.testing.assert_allclose([m.position_m for m in played], expected_m, rtol=0.0, atol=2e-5)
    if recording.force_n is None:
        return
    answers, times_s = replayed(traffic, FORCE)
    assert all(m.valid for m in answers)
    np.testing.assert_allclose(
        [m.force_n for m in answers],
        resisting(recording) * np.interp(times_s, recording.time_s, recording.force_n),
        rtol=1e-9,
        atol=1e-12,
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_a_recording_is_played_to_its_end_and_never_across_its_gap(tmp_path: Path, sign: int) -> None:
    path = gapped(tmp_path / "run.csv", sign)
    recording = load_recording(path)
    assert resisting(recording) == sign
    traffic = run_with(recording=path, impairment="5g")
    check_playback(traffic, recording)
    _, times_s = replayed(traffic, FORCE)
    for piece in recording.segments():
        inside = times_s[(times_s >= recording.time_s[piece][0]) & (times_s <= recording.time_s[piece][-1])]
        # a few ms of each end may be lost on the way, or with the deadman
        assert inside.min() < recording.time_s[piece][0] + 0.010
        assert inside.max() > recording.time_s[piece][-1] - 0.010
    names = [event for _, event in traffic.events()]
    cycle = ["engage", "engaged", "release", "at_rest"]
    assert names == ["session_opened", *cycle, *cycle]
    assert traffic.messages(SLAVE_STATE)[-1].stops == 0
    assert traffic.messages(MASTER_STATE)[-1].clutched_s > 0.5  # the person's reaction at the gap
    # between the release and the next engagement nothing moves
    release_s, engage_s = traffic.times("at_rest")[0], traffic.times("engage")[1]
    time_s = traffic.column(FORCE, "stamp_ns") / S
    still = (time_s > release_s + 0.1) & (time_s < engage_s)
    assert still.sum() > 200
    assert np.ptp(traffic.column(FORCE, "position_m")[still]) <= 2e-6


def test_a_measured_recording_is_played(data_dir: Path) -> None:
    path = data_dir / "human_motion.csv"
    traffic = run_with(recording=path, impairment="paper", duration_s=4.0)
    recording = load_recording(path)
    check_playback(traffic, recording)
    assert traffic.messages(SLAVE_STATE)[-1].stops == 0
    answers, at_s = replayed(traffic, FORCE)
    asked_m = np.interp(at_s, recording.time_s, recording.position_m)
    off_m = np.abs(asked_m - [m.position_m for m in answers])
    fastest_m_s = max(
        np.max(np.abs(np.diff(recording.position_m[piece]) / np.diff(recording.time_s[piece])), initial=0.0)
        for piece in recording.segments()
    )
    assert off_m.max() < fastest_m_s * 0.030 + 2e-5  # the servo, and what evens out the jitter


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"max_velocity_m_s": 0.3}, "max_velocity_m_s: 0.2 here, 0.3 there"),
        ({"workspace_m": (-0.002, 0.1)}, "workspace_m"),
        ({"kind": "rotation"}, "kind: insertion here, rotation there"),
    ],
)
def test_ends_that_disagree_do_not_arm_and_say_on_what(limits: dict[str, Any], said: str) -> None:
    plan = make_plan(LoopbackOptions(duration_s=1.0))
    master_axis = deep_merge(plan.master["axes"][0], {"limits": limits})
    traffic = run_plan(replace(plan, master={**plan.master, "axes": [master_axis]}))
    assert {state.state.value for state in traffic.messages(SLAVE_STATE)} == {"idle"}
    assert not traffic.messages(COMMAND)
    (answer,) = traffic.messages(SLAVE_HANDSHAKE)
    assert not answer.accepted
    assert said in answer.reason
    assert said in traffic.messages(MASTER_STATE)[-1].reason
    assert len(traffic.messages(MASTER_HANDSHAKE)) == 1  # asking again would not help


def test_a_recorded_impairment_is_replayed_message_by_message(tmp_path: Path) -> None:
    plan = make_plan(LoopbackOptions(seed=3, impairment="lte", duration_s=2.0))
    loop = looped(plan, 3)
    loop.write(tmp_path / "run.mcap")
    replay = {"impairment": {"replay": str(tmp_path / "run.mcap")}}
    again = replace(plan, slave={**plan.slave, **replay}, master={**plan.master, **replay})
    repeated = run_plan(again, 3)
    run = Run(tmp_path / "run.mcap")
    trace = run.impairment_trace("slave/impairment", "inbound")
    assert len(trace) > 1500
    assert len({delays for delays in trace if delays}) > 1000
    assert repeated.payloads == traffic_of(loop).payloads  # with the codec and without


def test_the_model_files_of_both_ends_are_used(tmp_path: Path) -> None:
    world, predictor = tmp_path / "world.yaml", tmp_path / "predictor.yaml"
    for file, softer in ((world, 1.0), (predictor, 0.8)):
        spring = {"mass_kg": 0.02, "damping_n_s_m": 2.0 * softer, "stiffness_n_m": 20.0 * softer}
        write_model(file, "mass_damper_spring", spring)
    traffic = run_with(slave_model=world, master_model=predictor, duration_s=5.0, impairment="lan")
    samples = traffic.messages(FORCE)
    depth_m = max(s.position_m for s in samples)
    pressed = [s for s in samples if s.position_m > 0.5 * depth_m and abs(s.velocity_m_s) < 0.002]
    assert len(pressed) > 100
    for sample in pressed:  # the load cell adds 10 mN of bias, and noise
        assert sample.force_n == pytest.approx(20.0 * sample.position_m, abs=0.03)
    parameters = traffic.messages(PARAMETERS)[-1]
    found = dict(zip(parameters.names, parameters.values, strict=True))
    assert found["mass_damper_spring.stiffness_n_m"] == pytest.approx(20.0, rel=0.15)
    assert parameters.model == ("mass_damper_spring",)
    assert parameters.valid


def test_a_commanded_restroke_inserts_further_and_each_grip_is_a_new_contact() -> None:
    """Grip, push, release, draw back, grip again."""
    plan = make_plan(LoopbackOptions(seed=1, impairment="lan", duration_s=5.1))
    plan.master["axes"][0]["handle"] |= {"restroke": True, "insert_s": 0.9, "withdraw_s": 0.7, "dwell_s": 0.3}
    samples = traffic_of(looped(plan)).messages(FORCE)
    grips = [s.gripper for s in samples]
    openings = [i for i in range(1, len(grips)) if (grips[i - 1], grips[i]) == (Grip.CLOSED, Grip.OPEN)]
    closings = [i for i in range(1, len(grips)) if (grips[i - 1], grips[i]) == (Grip.OPEN, Grip.CLOSED)]
    assert len(openings) == 2
    assert len(closings) == 1
    # let go, the load cell soon feels its own bias and noise only, while the stage draws back
    released = samples[openings[0] + 50 : closings[0]]
    assert max(abs(s.force_n - 0.01) for s in released) < 0.02
    assert released[0].position_m - released[-1].position_m > 0.02
    # two pushes, though the stage never went beyond one stroke: the second meets more friction than the first
    starts = (0, closings[0])
    pushed_m = [samples[i].position_m - samples[j].position_m for i, j in zip(openings, starts, strict=True)]
    assert sum(pushed_m) > 1.5 * max(s.position_m for s in samples)
    first_n, second_n = (max(s.force_n for s in samples[j:i]) for i, j in zip(openings, starts, strict=True))
    assert second_n > 1.1 * first_n
