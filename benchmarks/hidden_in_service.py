"""One effect hidden in a run's simulated world, named, and loaded: `python -m benchmarks.hidden_in_service`.

For each effect: a run in virtual time through the paper's impairment whose world holds it and whose master
does not know it; the diagnosis of that run's recording; a second run of the same world, operator and network
with the extended model loaded. Printed: what was named, and the rms error of the live prediction in mN in the
first run and in the second one, over all scored commands and from 3 s after the first of them on, beside the
zero-order hold's.

Arguments: names of effects (default: all).
"""

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import yaml

from forefeel.common.causes.model import SCHEMA
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.summary import summarise

DURATION_S = 20.0  # s of a run, the default of `forefeel loopback --duration`
SEED = 1  # of operator, world and network in both runs; arbitrary
WALL = {"mass_kg": 0.02, "damping_n_s_m": 0.6, "stiffness_n_m": 12.0}
HIDDEN: dict[str, dict[str, float]] = {
    "bias": {"force_n": 0.1},
    "coulomb_friction": {"force_n": 0.12},
    "stribeck_friction": {"coulomb_n": 0.08, "static_n": 0.2, "stribeck_velocity_m_s": 0.008},
    "presliding_hysteresis": {"force_n": 0.12, "stiffness_n_m": 60.0},
    "position_dependent_friction": {"force_per_length_n_m": 4.0},
    "backlash": {"width_m": 0.006},
    "stiffening": {"quadratic_n_m2": 0.0, "cubic_n_m3": 9000.0},
    "contact_loss": {"contact_position_m": 0.015},
    "stiffness_change": {"stiffness_n_m": 12.0, "time_s": 10.0, "ratio": 1.8},
    "yielding_wall": {"yield_n": 0.25, "stiffness_n_m": 15.0, "contact_position_m": 0.01},
    "prolapse": {"stiffness_n_m": 12.0, "limit_n": 0.25, "again_n": 0.1, "kept": 0.4},
    "stress_relaxation": {"stiffness_n_m": 12.0, "time_constant_s": 0.7},
    "asymmetric_damping": {"forward_n_s_m": 4.0, "backward_n_s_m": 0.5},
    "quadratic_drag": {"drag_n_s2_m2": 120.0},
    "hunt_crossley_damping": {"damping_n_s_m2": 150.0},
    "unmodelled_resonance": {"stiffness_n_m": 60.0, "frequency_hz": 5.0, "damping_ratio": 0.08},
    "time_delay": {"delay_s": 0.06},
    "sensor_lag": {"time_constant_s": 0.08},
    "sensor_drift": {"rate_n_s": 0.01},
    "sensor_saturation": {"limit_n": 0.25},
    "sensor_quantisation": {"step_n": 0.06},
    "sensor_spikes": {"rate_hz": 1.0, "amplitude_n": 0.5},
    "pulsation": {"amplitude_n": 0.08, "frequency_hz": 1.17, "second_harmonic_ratio": 0.3},
    "varying_pulsation": {"amplitude_n": 0.08, "frequency_hz": 1.17, "variation_hz": 0.1},
    "mains_hum": {"amplitude_n": 0.06, "frequency_hz": 50.0},
}
"""What is hidden, and how large: 20 to 200 mN beside a wall of some 0.4 N."""


@dataclass(frozen=True, slots=True)
class Row:
    """One effect: what was named, and rms errors in mN of (all, settled)."""

    named: str
    before_mn: tuple[float, float]
    after_mn: tuple[float, float]
    zoh_mn: tuple[float, float]


def in_service(effect: str, folder: Path) -> Row:
    """Both runs and the diagnosis between them."""
    world, hidden, found = (folder / f"{name}.yaml" for name in ("world", "hidden", "found"))
    write_model(world, "mass_damper_spring", WALL)
    write_model(hidden, effect, HIDDEN[effect])
    first = _run(
        LoopbackOptions(SEED, "paper", duration_s=DURATION_S, slave_model=world, hide=hidden),
        folder / "1.mcap",
    )
    diagnosed = diagnose(first.to_recording())
    found.write_text(dump_mapping(extended_model(diagnosed.analysis, "found").to_mapping()), encoding="utf-8")
    again = LoopbackOptions(
        SEED, "paper", duration_s=DURATION_S, slave_model=world, hide=hidden, master_model=found
    )
    second = _run(again, folder / "2.mcap")
    names = ", ".join(cause.name for cause in diagnosed.diagnosis.causes)
    before, after = summarise(first), summarise(second)
    return Row(
        names or diagnosed.diagnosis.verdict,
        (_mn(before.prediction.rms_n), _mn(before.settled.prediction.rms_n)),
        (_mn(after.prediction.rms_n), _mn(after.settled.prediction.rms_n)),
        (_mn(before.zoh.rms_n), _mn(before.settled.zoh.rms_n)),
    )


def write_model(path: Path, effect: str, parameters: dict[str, float]) -> None:
    entry = {"effect": effect, "parameters": parameters}
    path.write_text(yaml.safe_dump({"schema": SCHEMA, "name": effect, "effects": [entry]}), encoding="utf-8")


def _run(options: LoopbackOptions, path: Path) -> Run:
    loop = VirtualLoopback(make_plan(options), options.seed)
    loop.run(lambda _done_s: None)
    loop.write(path)
    return Run(path)


def _mn(rms_n: float | None) -> float:
    return float("nan") if rms_n is None else 1e3 * rms_n


def main(names: list[str]) -> None:
    """Prints the table, a row as soon as it is known."""
    print(f"{DURATION_S:g} s in virtual time, impairment paper, seed {SEED}; rms in mN: all / settled")
    print(f"{'hidden':28}{'named':48}{'before':>14}{'after':>14}{'ZOH':>14}")
    start_s = time.process_time()
    for name in names or HIDDEN:
        with tempfile.TemporaryDirectory() as folder:
            row = in_service(name, Path(folder))
        sizes = (f"{whole:6.1f} / {late:5.1f}" for whole, late in (row.before_mn, row.after_mn, row.zoh_mn))
        print(f"{name:28}{row.named:48}" + "".join(sizes), flush=True)
    print(f"{time.process_time() - start_s:.0f} s of one core")


if __name__ == "__main__":
    main(sys.argv[1:])
