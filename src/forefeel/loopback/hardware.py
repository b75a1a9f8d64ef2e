"""A loopback over real byte protocols: emulated devices, a process each, in place of the simulated ones."""

from dataclasses import replace
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.common.settings import AxisLimits
from forefeel.loopback.plan import Plan

SIMULATED = "simulated"
SERIAL, CAN = "emulated-serial", "emulated-can"
HARDWARE = SIMULATED, SERIAL, CAN
_BEYOND_M = 0.004  # m of travel beyond the workspace at each end
# N, full scale of the emulated load cells; over three times the 3 N of the catheter's force limit
_FULL_SCALE_N = 10.0
_FASTER = 2.0  # speed and acceleration of the drive over the limits, so that it follows them
_Words = tuple[str, ...]
_Devices = dict[str, dict[str, object]]
Emulators = dict[str, _Words]
"""The words after `forefeel emulate` by the emulator's name, in the order of their start."""


def check_hardware(hardware: str, recording: bool, virtual: bool) -> None:
    """Refuses an unknown `--hardware`, and any but the simulated one with a recording or in virtual time.

    Raises:
        ConfigurationError: one of these.
    """
    if hardware not in HARDWARE:
        raise ConfigurationError(f"--hardware {hardware!r}: expected one of {', '.join(HARDWARE)}")
    if hardware == SIMULATED:
        return
    if recording:
        raise ConfigurationError(
            f"--hardware {hardware}: the synthetic operator holds its handle; expected no --recording"
        )
    if virtual:
        raise ConfigurationError(
            f"--hardware {hardware}: its devices live on the wall clock; expected no --virtual-time"
        )


def on_bench(plan: Plan, hardware: str, ports: Path, out: Path, seed: int) -> tuple[Plan, Emulators]:
    """Copy of the plan with drivers of emulated stage, load cell and handle at ports in the folder `ports`;
    and the words of each emulator's command, which reads slave.yaml or master.yaml in `out`. The plan itself
    and no emulator with simulated hardware.
    """
    if hardware == SIMULATED:
        return plan, {}
    axis = plan.slave_settings().axes[0]
    limits = axis.limits
    common = ("--seed", str(seed))
    words = "--config", str(out / "slave.yaml"), "--feel", str(ports / "feel"), *common
    if hardware == SERIAL:
        devices, emulators = _serial(limits, ports, words)
    else:
        devices, emulators = _can(limits, ports, words, common)
    devices["load_cell"] |= {"pushes_only": axis.pushes_only, "filter_lag_s": 0.001}
    devices["gripper"] = {"driver": "simulated"}
    handle = {
        "driver": "coil_serial", "port": str(ports / "handle"), "counts_per_m": 1e6, "newton_per_ampere": 2.0,
        "max_current_a": 3.0, "watchdog_s": 0.1,
    }  # fmt: skip
    emulators["handle"] = "coil_serial", "--config", str(out / "master.yaml"), *common
    changed = replace(
        plan,
        slave={**plan.slave, "axes": [{**plan.slave["axes"][0], **devices}]},
        master={**plan.master, "axes": [{**plan.master["axes"][0], "handle": handle}]},
        metadata={**plan.metadata, "hardware": hardware},
    )
    return changed, emulators


def _motion(limits: AxisLimits) -> dict[str, object]:
    low_m, high_m = limits.workspace_m
    return {
        "travel_m": [low_m - _BEYOND_M, high_m + _BEYOND_M],
        "max_velocity_m_s": _FASTER * limits.max_velocity_m_s,
    }


def _serial(limits: AxisLimits, ports: Path, words: _Words) -> tuple[_Devices, Emulators]:
    """Settings of a Zaber stage and a Bota load cell, each on a serial line of its own; and the words of
    their emulators' commands, which get `words`.
    """
    stage = {
        "driver": "zaber_ascii", "port": str(ports / "stage"), "microstep_m": 1e-7,
        "max_acceleration_m_s2": _FASTER * limits.max_acceleration_m_s2, **_motion(limits),
    }  # fmt: skip
    cell = {"driver": "bota_serial", "port": str(ports / "cell"), "full_scale_n": _FULL_SCALE_N}
    emulators: Emulators = {"cell": ("bota_serial", *words), "stage": ("zaber_ascii", *words)}
    return {"stage": stage, "load_cell": cell}, emulators


def _can(limits: AxisLimits, ports: Path, words: _Words, common: _Words) -> tuple[_Devices, Emulators]:
    """Settings of a CiA 402 drive and a CiA 404 transducer on one CAN bus, and the words of their emulators'
    commands: a hub with an end for each of them and one for the slave. `words`: of both; `common`: of all.
    """
    slave_end, stage_end, cell_end = (str(ports / name) for name in ("can-slave", "can-drive", "can-cell"))
    can = {"interface": "slcan", "channel": slave_end}
    stage = {
        "driver": "cia402", "can": can, "node_id": 1, "counts_per_m": 1e7, "heartbeat_s": 0.05,
        **_motion(limits),
    }  # fmt: skip
    cell = {"driver": "cia404", "can": can, "node_id": 2, "full_scale_n": _FULL_SCALE_N}
    emulators: Emulators = {
        "hub": ("can_hub", "--port", ",".join((slave_end, stage_end, cell_end)), *common),
        "cell": ("cia404", "--port", cell_end, *words),
        "stage": ("cia402", "--port", stage_end, *words),
    }
    return {"stage": stage, "load_cell": cell}, emulators
