"""The simulated world of one axis: stage, fixture, vessel and load cell on one time grid."""

from collections.abc import Callable, Mapping, Sequence
from math import exp, pi
from random import Random

from forefeel.common.causes.motion import Lag
from forefeel.common.messages import Grip
from forefeel.slave.load_cell import VALID_SHARE, LoadCellReading
from forefeel.slave.plant.contact import PlantFixture, plant_contact
from forefeel.slave.plant.foreign import ForeignContact, Point
from forefeel.slave.plant.settings import LoadCellSettings, WorldSettings
from forefeel.slave.plant.stage import PlantStage

CATCH_UP_S = 5.0
"""Longest span that one call integrates. What lies before is skipped: while the host stalls, the drive's
watchdog stops the stage, and 5 s are enough for that and for the contact to settle."""

_CONVERSION_RATE_HZ = 1000  # one for each tick of the control loop
_RATE_HZ = 5_000
"""Servo, lags, presliding and relaxation are exact from step to step. Dry friction turns within a step: with
4 kHz a diagnosis takes such steps for spikes of the load cell (`tests/simulation/test_hidden_in_service.py`).
"""
_PERIOD_S = 1e-3  # s between two conversions


class PlantLoadCell:
    """A first-order anti-alias filter at the integration rate, one conversion per ms with white noise.
    `sense`: what else becomes of a reading: (t s, force N, dt s) -> N.
    """

    def __init__(
        self,
        settings: LoadCellSettings,
        seed: int,
        sense: Callable[[float, float, float], float] = lambda t, force_n, dt: force_n,
    ) -> None:
        self._settings = settings
        self._sense = sense
        self._random = Random(seed)
        self._most_counts = 2 ** (settings.bits - 1) - 1
        self._newton_per_count = settings.full_scale_n / self._most_counts
        self.full_scale_n: float = self._most_counts * self._newton_per_count
        self.filtered = Lag()
        self.decay = exp(-2.0 * pi * settings.filter_hz / _RATE_HZ)
        """Of the filter in one step of the integration."""
        self.reading = LoadCellReading(0.0, 0, False)
        """The newest conversion; invalid before the first."""

    def convert(self, t: float) -> None:
        """Replaces `reading` by a conversion of the filtered force: bias, drift at t, noise, effects of the
        sensor, whole counts; not valid beyond 95 % of full scale.
        """
        settings = self._settings
        noise_n = self._random.gauss(0.0, settings.noise_n)
        reading_n = self.filtered.value + settings.bias_n + settings.drift_n_s * t + noise_n
        reading_n = self._sense(t, reading_n, _PERIOD_S)
        most = self._most_counts
        raw = max(-most, min(most, round(reading_n / self._newton_per_count)))
        self.reading = LoadCellReading(raw * self._newton_per_count, raw, abs(raw) <= VALID_SHARE * most)


class SimulatedWorld:
    """Integrates at 5 kHz; the load cell converts once per ms.

    Steps lie on a grid that starts at the stamp of the first call, and random numbers are drawn on that
    grid: equal seeds, setpoints and grips give equal results bit for bit, however often the world is read.

    Attributes:
        start_ns: when its time began; None before the first call.
        observed: whether a stage or a load cell belongs to the world; else its gripper does not integrate it.
        others: worlds of other axes by name, whose stages the contact follows.
    """

    def __init__(self, settings: WorldSettings, seed: int) -> None:
        self.observed = False
        self.others: Mapping[str, SimulatedWorld] = {}
        self._dt = 1.0 / _RATE_HZ
        self._stage = PlantStage(settings.stage, self._dt)
        self._contact, converter = plant_contact(settings)
        self._fixture = PlantFixture(self._contact, settings.fixture.inserted_m, settings.stage.start_m)
        self._load_cell = PlantLoadCell(settings.load_cell, seed, converter.sense)
        self.start_ns: int | None = None
        self._steps = 0

    def advance(self, to_ns: int) -> None:
        """Integrates to that stamp, its last 5 s at most. The first call only sets the start; an earlier
        stamp than before is ignored.
        """
        due = self._elapsed_ns(to_ns) * _RATE_HZ // 1_000_000_000
        if due > self._steps:
            self._integrate(max(self._steps, due - int(CATCH_UP_S * _RATE_HZ)), due)

    def set_target(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """Sets the stage's setpoint at that stamp; returns its position as applied within the travel."""
        self.advance(now_ns)
        return self._stage.command(position_m, velocity_m_s, self._elapsed_ns(now_ns) * 1e-9)

    def hold(self) -> None:
        """Decelerates the stage, which stays until the next setpoint; safe from any thread."""
        self._stage.hold()

    def grip(self, grip: Grip) -> Grip:
        return self._fixture.set(grip, self._stage.position_m)

    def stage_readback(self) -> tuple[float, float]:
        """(position_m of the motor's encoder, velocity_m_s) of the last step."""
        return self._stage.readback()

    @property
    def load_cell_full_scale_n(self) -> float:
        return self._load_cell.full_scale_n

    def load_cell_reading(self) -> LoadCellReading:
        """The newest conversion; invalid before the first ms has passed."""
        return self._load_cell.reading

    @property
    def shape_m(self) -> Callable[[], Sequence[Point]] | None:
        """Reads the centre line of the instrument; None where no engine of others has one."""
        if not (self.observed and isinstance(self._contact, ForeignContact)):
            return None
        return self._contact.world.shape_m if self._contact.world.shape_m() else None

    @property
    def inserted_m(self) -> float:
        """Depth of the instrument, as the vessel sees it, over all strokes."""
        return self._fixture.inserted_m

    def _elapsed_ns(self, stamp_ns: int) -> int:
        if self.start_ns is None:
            self.start_ns = stamp_ns
        return stamp_ns - self.start_ns

    def _integrate(self, first: int, last: int) -> None:
        """Steps stage, fixture and the cell's filter from after step `first` to `last`; converts each ms."""
        stage, fixture, cell = self._stage.step, self._fixture.step, self._load_cell
        dt, per_conversion = self._dt, _RATE_HZ // _CONVERSION_RATE_HZ
        self._contact.follow({name: other._stage.position_m for name, other in self.others.items()})
        for step in range(first + 1, last + 1):
            t = step * dt
            x, v, a = stage(t)
            cell.filtered.step(fixture(t, x, v, a, dt), cell.decay)
            if step % per_conversion == 0:
                cell.convert(t)
        self._steps = last
