"""Runs of the simulated bench: the whole product in virtual time, over the network that the paper assumes."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from forefeel.common.config import deep_merge
from forefeel.common.errors import RunError
from forefeel.common.recording.mcap_reader import Run as RecordedRun
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.topics import FORCE, HAPTICS
from forefeel.diagnosis.reproduction.contact import Array
from forefeel.diagnosis.reproduction.replay import ReplayedRun
from forefeel.loopback.plan import AXIS, LoopbackOptions, Plan, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.score import first_answers

IMPAIRMENT = "paper"
"""150 ms one way: a round trip of 300 ms."""

STYLES: dict[str, dict[str, float]] = {
    "slow and careful": {
        "insert_s": 3.0,
        "withdraw_s": 2.4,
        "dwell_s": 0.8,
        "depth_m": 0.025,
        "tremor_m": 0.0001,
    },
    "normal": {"insert_s": 1.8, "withdraw_s": 1.4, "dwell_s": 0.6, "depth_m": 0.030, "tremor_m": 0.0002},
    "fast": {"insert_s": 0.9, "withdraw_s": 0.7, "dwell_s": 0.3, "depth_m": 0.035, "tremor_m": 0.0005},
}
"""Settings of the simulated operator, see `forefeel.master.settings.OperatorSettings`."""

INSTRUMENTS = "catheter", "guidewire"


def bench_run(instrument: str, style: str, duration_s: float, seed: int) -> ReplayedRun:
    """One operator with one instrument; what the load cell measured and what the product predicted for it.

    Raises:
        RunError: the slave never followed.
    """
    plan = _plan(instrument, style, duration_s, seed)
    loop = VirtualLoopback(plan, seed)
    loop.run(lambda _done_s: None)
    with TemporaryDirectory(prefix="forefeel-") as folder:
        path = Path(folder) / f"{instrument}.mcap"
        loop.write(path)
        recorded = read_run(path)
    product_n = _product_n(recorded)
    if not np.isfinite(product_n).any():
        raise RunError(f"simulated bench, {instrument}, {style}: nothing was predicted in {duration_s:g} s")
    delay_s = recorded.column(AXIS, HAPTICS, "delay_s").astype(np.float64)
    rendering = plan.master_settings().axes[0].rendering
    name = f"{instrument}, {style}"
    return ReplayedRun(
        name=name,
        recording=replace(recorded.to_recording(AXIS), name=name, source=f"simulated bench: {name}"),
        product_n=product_n,
        bench=True,
        instrument=instrument,
        style=style,
        force_scale=rendering.force_scale,
        round_trip_s=float(np.nanmedian(delay_s)),
    )


def _plan(instrument: str, style: str, duration_s: float, seed: int) -> Plan:
    plan = make_plan(
        LoopbackOptions(seed=seed, impairment=IMPAIRMENT, preset=instrument, duration_s=duration_s)
    )
    axis = deep_merge(plan.master["axes"][0], {"handle": STYLES[style]})
    return replace(plan, master={**plan.master, "axes": [axis]})


def _product_n(run: RecordedRun) -> Array:
    """For each sample of the recording, what was predicted in the tick whose command it answers first."""
    valid = run.column(AXIS, FORCE, "valid").astype(bool)
    stamp_ns = run.column(AXIS, FORCE, "stamp_ns")
    answers = run.column(AXIS, FORCE, "answers_sequence").astype(np.float64)
    rows = np.flatnonzero(valid & np.isfinite(answers))
    index = first_answers(
        (run.column(AXIS, HAPTICS, "session_id"), run.column(AXIS, HAPTICS, "sequence")),
        (run.column(AXIS, FORCE, "session_id")[rows], answers[rows]),
        stamp_ns[rows],
    )
    known = index >= 0
    stamps_ns = np.unique(stamp_ns[valid])  # as the recording has them
    product_n = np.full(len(stamps_ns), np.nan)
    predicted_n = run.column(AXIS, HAPTICS, "predicted_n").astype(np.float64)
    product_n[np.searchsorted(stamps_ns, stamp_ns[rows][index[known]])] = predicted_n[known]
    return product_n
