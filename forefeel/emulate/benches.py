"""Each emulated device, built from the section of a YAML file that its driver reads, so that both agree."""

from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path

from forefeel.emulate.bota import EmulatedBota
from forefeel.emulate.coil import CoilDevice, CoilHardware
from forefeel.emulate.device import EmulatedDevice
from forefeel.emulate.line_cell import EmulatedHx711, EmulatedLoadstar
from forefeel.emulate.orders import Load
from forefeel.emulate.sensing import Sensing
from forefeel.emulate.wall import ForceReceiver, ForceSender, Wall
from forefeel.emulate.zaber import ZaberDevice
from forefeel.emulate.zaber_settings import ZaberModel
from forefeel.master.settings import CoilSettings
from forefeel.slave.load_cells.settings import AsciiLineSettings, BotaSettings
from forefeel.slave.plant.settings import WorldSettings
from forefeel.slave.stages.settings import ZaberSettings

_NOISE_N = 0.002
_BEHIND_M = 0.001


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What an emulated device is put into. `feel`: the socket between stage and load cell; None: alone.
    `load`: what hangs on the cell besides.
    """

    world: WorldSettings
    feel: Path | None
    seed: int
    load: Load = field(default_factory=Load)


@dataclass(frozen=True, slots=True)
class SerialBench:
    """A device behind a serial port, and its speed."""

    device: EmulatedDevice
    port: Path
    baud: int


def zaber(settings: ZaberSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """The stage, with the vessel in front of it."""
    low_m, high_m = sorted(settings.sign * end_m for end_m in settings.travel_m)
    model = ZaberModel(
        address=settings.device,
        microstep_m=settings.microstep_m,
        limits_m=(low_m - _BEHIND_M, high_m + _BEHIND_M),
        start_m=settings.sign * around.world.stage.start_m,
    )
    return SerialBench(
        ZaberDevice(model, moved(around, settings.sign, leave)), Path(settings.port), settings.baud
    )


def bota(settings: BotaSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """The six-axis cell on the stage."""
    sensing = _sensing(settings, around)
    device = EmulatedBota(felt(around, settings.sign, leave), sensing, settings.component)
    return SerialBench(device, Path(settings.port), settings.baud)


def ascii_line(settings: AsciiLineSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """A cell that prints: Loadstar's where it is asked, an HX711 sketch's where it streams counts."""
    sensing = _sensing(settings, around)
    feel = felt(around, settings.sign, leave)
    device = EmulatedHx711(feel, sensing) if settings.unit == "counts" else EmulatedLoadstar(feel, sensing)
    return SerialBench(device, Path(settings.port), settings.baud)


def _sensing(settings: BotaSettings | AsciiLineSettings, around: Surroundings) -> Sensing:
    return Sensing(settings.rate_hz, full_scale_n=settings.full_scale_n, noise_n=_NOISE_N, seed=around.seed)


def coil(settings: CoilSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """The handle in the hand of the synthetic operator."""
    del leave
    hardware = CoilHardware(
        counts_per_m=settings.counts_per_m,
        newton_per_ampere=settings.newton_per_ampere,
        sign=settings.sign,
        peak_a=settings.max_current_a,
    )
    return SerialBench(CoilDevice(hardware, seed=around.seed), Path(settings.port), settings.baud)


def moved(around: Surroundings, sign: int, leave: ExitStack) -> Callable[[float, float, float, float], None]:
    """What an emulated stage calls at every step: the vessel feels it, the load cell is told."""
    wall = Wall(around.world)
    sender = None if around.feel is None else leave.enter_context(closing(ForceSender(around.feel)))

    def on_motion(t_s: float, x_m: float, v_m_s: float, a_m_s2: float) -> None:
        wall.moved(t_s, sign * x_m, sign * v_m_s, sign * a_m_s2)
        if sender is not None:
            sender.send(wall.force_n)

    return on_motion


def felt(around: Surroundings, sign: int, leave: ExitStack) -> Callable[[float], float]:
    """The force in N on an emulated load cell at a time."""
    load = around.load
    if around.feel is None:
        return lambda _t_s: sign * load.force_n
    receiver = leave.enter_context(closing(ForceReceiver(around.feel)))
    return lambda t_s: sign * (receiver.newest_n(t_s) + load.force_n)
