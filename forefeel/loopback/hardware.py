"""A loopback over real byte protocols: emulated devices, each in a process of its own, in place of the
simulated ones.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from common.errors import ConfigurationError
from forefeel.loopback.plan import Plan

SIMULATED = "simulated"
SERIAL, CAN = "emulated-serial", "emulated-can"
HARDWARE = SIMULATED, SERIAL, CAN
_BEYOND_M = 0.004
_FULL_SCALE_N = 10.0
_FASTER = 2.0
"""How much faster than the limits the drive could be, so that it follows them."""


@dataclass(frozen=True, slots=True)
class Emulated:
    """One emulator: its name, the words after `forefeel emulate`. It says a line when it is there."""

    name: str
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Bench:
    """The plan on emulated devices, and the emulators in the order of their start."""

    plan: Plan
    emulators: tuple[Emulated, ...]


def check_hardware(hardware: str, recording: bool, virtual: bool) -> None:
    """Refuses what can not be.

    Raises:
        ConfigurationError: an unknown name, or emulated hardware with a recording or in virtual time.
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


def on_bench(plan: Plan, hardware: str, ports: Path, out: Path, seed: int) -> Bench:
    """The plan with emulated devices, whose ports lie in the folder `ports`; `out` gets the settings."""
    feel = ports / "feel"
    slave_axis, master_axis = dict(plan.slave["axes"][0]), dict(plan.master["axes"][0])
    limits = plan.slave_settings().axes[0].limits
    low_m, high_m = limits.workspace_m
    motion = {
        "travel_m": [low_m - _BEYOND_M, high_m + _BEYOND_M],
        "max_velocity_m_s": _FASTER * limits.max_velocity_m_s,
    }
    slave_file, master_file = str(out / "slave.yaml"), str(out / "master.yaml")
    common = ("--seed", str(seed))
    felt = ("--feel", str(feel), *common)
    if hardware == SERIAL:
        stage, cell = ports / "stage", ports / "cell"
        slave_axis["stage"] = {
            "driver": "zaber_ascii", "port": str(stage), "microstep_m": 1e-7,
            "max_acceleration_m_s2": _FASTER * limits.max_acceleration_m_s2, **motion,
        }  # fmt: skip
        slave_axis["load_cell"] = {"driver": "bota_serial", "port": str(cell), "full_scale_n": _FULL_SCALE_N}
        emulators = [
            Emulated("cell", ("bota_serial", "--config", slave_file, *felt)),
            Emulated("stage", ("zaber_ascii", "--config", slave_file, *felt)),
        ]
    else:
        ends = {name: ports / name for name in ("can-slave", "can-drive", "can-cell")}
        can = {"interface": "slcan", "channel": str(ends["can-slave"])}
        slave_axis["stage"] = {
            "driver": "cia402",
            "can": can,
            "node_id": 1,
            "counts_per_m": 1e7,
            "heartbeat_s": 0.05,
            **motion,
        }
        slave_axis["load_cell"] = {
            "driver": "cia404",
            "can": can,
            "node_id": 2,
            "full_scale_n": _FULL_SCALE_N,
        }
        hub = ",".join(map(str, ends.values()))
        emulators = [
            Emulated("hub", ("can_hub", "--port", hub, *common)),
            Emulated("cell", ("cia404", "--config", slave_file, "--port", str(ends["can-cell"]), *felt)),
            Emulated("stage", ("cia402", "--config", slave_file, "--port", str(ends["can-drive"]), *felt)),
        ]
    handle = ports / "handle"
    master_axis["handle"] = {
        "driver": "coil_serial", "port": str(handle), "counts_per_m": 1e6, "newton_per_ampere": 2.0,
        "max_current_a": 3.0, "watchdog_s": 0.1,
    }  # fmt: skip
    emulators.append(Emulated("handle", ("coil_serial", "--config", master_file, *common)))
    changed = replace(
        plan,
        slave={**plan.slave, "axes": [slave_axis]},
        master={**plan.master, "axes": [master_axis]},
        metadata={**plan.metadata, "hardware": hardware},
    )
    return Bench(changed, tuple(emulators))


def emulator_command(emulated: Emulated) -> list[str]:
    """What starts it, after the interpreter."""
    return ["-m", "forefeel", "emulate", *emulated.words]
