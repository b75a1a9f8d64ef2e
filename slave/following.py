"""Watch over the stage by its readback, whatever its driver: it goes where sent and rests when told. Pure."""

from collections import deque
from math import copysign, e, exp, pi, sqrt

from forefeel.common.estimation.stage_lag import StageLag
from forefeel.slave.plant.stage import EXTRAPOLATION_S
from forefeel.slave.settings import SlaveAxisSettings
from forefeel.slave.stage import CARRIED_S, StageReading

DEVIATION_M = 1e-4
"""A healthy stage is below 0.06 mm (`python -m benchmarks.liars`). What grows by 4 mm/s is there in 25 ms."""
_REST_M, _REST_NS = 20e-6, 50_000_000
"""At rest: within 20 um for 50 ms, below 0.4 mm/s. A count of 1 um at 250 Hz flickers by 0.25 mm/s."""
_TO_REST_NS = 500_000_000
"""From 1 m/s at `gate.stop_deceleration_m_s2`, 4 m/s^2, it takes half of that."""
_STEP_S = 0.001
_APART_NS = 5_000_000  # between two setpoints that are remembered: at 8 m/s^2 they miss an end by 0.025 mm


class KnownServo:
    """Expected position, bandwidth known: `r'' = w^2 (s - r) + 2 w (s' - r')`, w = 2 pi bandwidth; s goes on
    with s' for 2 ms. `e = r - s` is `(e0 + (e0' + w e0) t) exp(-w t)` over 1 ms at most, in which |r''| stays
    within the limit of the drive: the setpoint jumps after a pause of the control loop. `blind_ns`: after a
    longer pause the drive has stopped by itself, and is where it reads.
    """

    carried_s, blind_ns = 0.0, 50_000_000

    def __init__(self, bandwidth_hz: float, acceleration_limit_m_s2: float) -> None:
        self._w = 2.0 * pi * bandwidth_hz
        self._most_m_s2 = acceleration_limit_m_s2
        self.rest(0.0, 0)

    def rest(self, position_m: float, now_ns: int) -> None:
        self._r = self._s = position_m
        self._v = self._feed = self._carried_s = 0.0
        self._now_ns = now_ns

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> None:
        self.span_m(now_ns)
        self._s, self._feed, self._carried_s = position_m, velocity_m_s, EXTRAPOLATION_S

    def span_m(self, now_ns: int) -> tuple[float, float]:
        """Advances the servo model to `now_ns`; returns its position in m twice, as lowest and highest."""
        elapsed_s, self._now_ns = (now_ns - self._now_ns) * 1e-9, now_ns
        carried_s = min(elapsed_s, self._carried_s)
        self._carried_s -= carried_s
        if carried_s > 0.0:
            self._integrate(self._feed, carried_s)
        if elapsed_s > carried_s:
            self._integrate(0.0, elapsed_s - carried_s)
        return self._r, self._r

    def _integrate(self, feed: float, duration_s: float) -> None:
        """Integrates the servo model over `duration_s`, in steps of 1 ms at most, within the acceleration
        limit. `feed`: velocity of the setpoint meanwhile, in m/s.
        """
        w = self._w
        while duration_s > 0.0:
            dt = min(duration_s, _STEP_S)
            duration_s -= dt
            e, before, decay = self._r - self._s, self._v, exp(-w * dt)
            c = before - feed + w * e
            self._s += feed * dt
            v, change = feed + (before - feed - w * c * dt) * decay, self._most_m_s2 * dt
            if abs(v - before) <= change:
                self._r = self._s + (e + c * dt) * decay
            else:
                v = before + copysign(change, v - before)
                self._r += 0.5 * (before + v) * dt
            self._v = v


class LateStage:
    """Span of a stage that reads back where it was sent, 0 to `lag_s` later, targets carried on with their
    velocity: the hull of s(u) and s(u) + s'(u) (t - u), t - lag <= u <= t. `carried_s`: time for which a
    reading may be carried on, too.
    """

    carried_s = CARRIED_S

    def __init__(self, lag_s: float) -> None:
        self._lag_ns = round(lag_s * 1e9)
        self.blind_ns = max(KnownServo.blind_ns, self._lag_ns)
        self._sent: deque[tuple[int, float, float]] = deque()

    def rest(self, position_m: float, now_ns: int) -> None:
        self._sent.clear()
        self.command(position_m, 0.0, now_ns)

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> None:
        self._newest = (now_ns, position_m, velocity_m_s)
        if not self._sent or now_ns - self._sent[-1][0] >= _APART_NS:
            self._sent.append(self._newest)

    def span_m(self, now_ns: int) -> tuple[float, float]:
        """Lowest and highest position in m of a healthy stage at `now_ns`: among the setpoints that hold
        within the lag, and each of them carried on to now with its velocity. Drops older setpoints.
        """
        sent, since_ns = self._sent, now_ns - self._lag_ns
        while len(sent) > 1 and sent[1][0] <= since_ns:
            sent.popleft()
        at_ns, x_m, v_m_s = sent[0]
        if at_ns < since_ns:
            sent[0] = (since_ns, x_m + v_m_s * (since_ns - at_ns) * 1e-9, v_m_s)
        ends = list[float]()
        for at_ns, x_m, v_m_s in (*sent, self._newest):
            ends += (x_m, x_m + v_m_s * (now_ns - at_ns) * 1e-9)
        return min(ends), max(ends)


class FollowingWatch:
    """Compares each readback with where a healthy stage may be; after a hold it has to come to rest.

    Args:
        lag: identified from the readbacks, where the settings do no more than bound it.

    Attributes:
        at_rest: whether the stage itself rests.
        deviation_m: of the newest readback from where the stage may be; 0 while it is told to hold.
        strayed: whether that is a fault.
        reaction_s: `stage_s` and `run_on_s` of `Reaction`, by `lag`; None without it, and until it is known.

    By (S1) a servo with velocity feed-forward has T1 = 0, T2 = -1 / w^2, one without T1 = 1 / w: late by T1,
    by 0.5 / w under acceleration, and overshoots by v / e w (`SlaveAxisSettings.reaction`).
    """

    def __init__(self, expected: KnownServo | LateStage, lag: StageLag | None = None) -> None:
        self._expected, self._lag = expected, lag
        self._holds = True
        self._read_ns = self._moved_ns = self._settled_ns = 0
        self._anchor_m = self._read_m = self.deviation_m = 0.0
        self.at_rest = self.strayed = False

    def command(self, applied_m: float, velocity_m_s: float, now_ns: int) -> None:
        self._holds = False
        self._expected.command(applied_m, velocity_m_s, now_ns)
        if self._lag is not None:
            self._lag.command(now_ns, applied_m)
            self._lag.observe(now_ns, self._read_m)

    @property
    def reaction_s(self) -> tuple[float, float] | None:
        if self._lag is None or not self._lag.known:
            return None
        lag_s, lag2_s2 = self._lag.lags
        servo_s = sqrt(abs(lag2_s2))
        return max(lag_s, 0.0) + 0.5 * servo_s, servo_s / e

    def hold(self) -> None:
        self._holds = True

    def read(self, reading: StageReading, now_ns: int) -> str | None:
        """Takes a readback: sets `at_rest`, `deviation_m` and `strayed`. Fault text where the stage is over
        0.1 mm off the span of its setpoints, or still moves 0.5 s after a hold; else None. While it holds, or
        after a gap in the readbacks, the expectation restarts at the readback.
        """
        self._read_m = x_m = reading.position_m
        blind = now_ns - self._read_ns > self._expected.blind_ns
        self._read_ns = now_ns
        if abs(x_m - self._anchor_m) > _REST_M:
            self._anchor_m, self._moved_ns = x_m, now_ns
        self.at_rest = now_ns - self._moved_ns >= _REST_NS
        if self.at_rest or blind or not self._holds:
            self._settled_ns = now_ns
        if self._holds or blind:
            self._expected.rest(x_m, now_ns)
        low_m, high_m = self._expected.span_m(now_ns)
        before_m = x_m - reading.velocity_m_s * self._expected.carried_s
        self.deviation_m = max(0.0, low_m - max(x_m, before_m), min(x_m, before_m) - high_m)
        self.strayed = self.deviation_m > DEVIATION_M
        if now_ns - self._settled_ns > _TO_REST_NS:
            return f"stage moves {_TO_REST_NS * 1e-9:g} s after it was told to hold: check the drive"
        if not self.strayed:
            return None
        return (
            f"stage at {x_m * 1e3:.2f} mm, {self.deviation_m * 1e3:.2f} mm off its setpoint: stuck, slipping "
            "or slower than the settings say; check what blocks it, and stage.lag_s"
        )


def following_watch(settings: SlaveAxisSettings) -> FollowingWatch:
    """Builds the watch: with the known servo of a simulated stage, else with `stage.lag_s` as bound."""
    if settings.stage.driver == "simulated":
        stage = settings.simulation.stage
        return FollowingWatch(KnownServo(stage.bandwidth_hz, stage.acceleration_limit_m_s2))
    lag_s = settings.stage.lag_s
    return FollowingWatch(LateStage(lag_s), StageLag(lag_s))
