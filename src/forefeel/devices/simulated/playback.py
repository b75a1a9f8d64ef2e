"""A handle whose motion is that of a recording. The hand is rigid; the rendered force does not move it."""

from bisect import bisect_right

from forefeel.common.clock import Clock
from forefeel.common.errors import RecordingError
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.recording import Recording
from forefeel.devices.simulated.operator import Act, MinimumJerk, SimulatedHandle
from forefeel.devices.simulated.settings import RecordedHandleSettings
from forefeel.master.handle import HandleReading


class RecordedMotion:
    """A measured position, linear between its samples, never across a gap longer than `GAP_S`.

    Attributes:
        pieces: (start, end) in s of each, in order; the clutch is opened between two.

    Raises:
        RecordingError: every sample stands alone between gaps.
    """

    def __init__(self, recording: Recording) -> None:
        self._time_s: list[float] = recording.time_s.tolist()
        self._position_m: list[float] = recording.position_m.tolist()
        segments = recording.segments()
        self._last = frozenset(segment.stop - 1 for segment in segments)
        spans = [(self._time_s[s.start], self._time_s[s.stop - 1]) for s in segments]
        self.pieces = [(start, end) for start, end in spans if end > start]
        if not self.pieces:
            raise RecordingError(f"{recording.source}: no two samples within {GAP_S:g} s, nothing to play")

    def at(self, t_s: float) -> tuple[float, float]:
        """(position m, velocity m/s) by linear interpolation; at the end of a piece by its last interval."""
        i = bisect_right(self._time_s, t_s) - 1
        i = max(0, i - (i in self._last))
        t0, x0 = self._time_s[i], self._position_m[i]
        velocity_m_s = (self._position_m[i + 1] - x0) / (self._time_s[i + 1] - t0)
        return x0 + velocity_m_s * (t_s - t0), velocity_m_s


class Playback(SimulatedHandle):
    """Plays a motion by absolute position: aligns with the stage, arms, goes to the start of the piece, plays
    it, opens the clutch.
    """

    def __init__(self, motion: RecordedMotion, approach_m_s: float) -> None:
        super().__init__()
        self._motion = motion
        self._approach_m_s = approach_m_s
        self._piece = 0
        self._play_s = motion.pieces[0][0]
        self._approach: MinimumJerk | None = None
        self._approach_s = 0.0
        self._position_m = 0.0

    def render(self, force_n: float, now_ns: int) -> float:
        del now_ns
        return force_n

    def read(self, now_ns: int) -> HandleReading:
        """Advances the simulated person and the playback to `now_ns` and returns where the hand is. While the
        person moves it goes to where the piece begins or was interrupted, then plays it on, with the time of
        the recording; otherwise it rests, at the stage while the person waits.
        """
        dt_s = self._step_s(now_ns)
        self.person.look(now_ns * 1e-9, self._indication.state)
        if self.finished or self.person.act is not Act.MOVING:
            return self._wait()
        if self._approach is None:
            self._aim()
        return self._go_to_start(dt_s) or self._play(now_ns, dt_s)

    def _wait(self) -> HandleReading:
        """Drops the approach; returns the reading at rest, at the stage while the person waits, so that
        arming moves nothing, else where the hand is.
        """
        self._approach = None
        if self.person.act is Act.WAITING and self._indication.stage_position_m is not None:
            self._position_m = self._indication.stage_position_m
        return HandleReading(self._position_m, 0.0, self.person.pressed and not self.finished)

    def _aim(self) -> None:
        target_m = self._motion.at(self._play_s)[0]
        duration_s = max(0.2, 1.9 * abs(target_m - self._position_m) / self._approach_m_s)
        self._approach = MinimumJerk(self._position_m, target_m, duration_s)
        self._approach_s = 0.0

    def _go_to_start(self, dt_s: float) -> HandleReading | None:
        """Returns the reading on the way to where the piece goes on, after `dt_s` more; None once there."""
        assert self._approach is not None
        self._approach_s += dt_s
        if self._approach_s > self._approach.duration_s:
            return None
        self._position_m, velocity_m_s = self._approach.at(self._approach_s)
        return HandleReading(self._position_m, velocity_m_s, True)

    def _play(self, now_ns: int, dt_s: float) -> HandleReading:
        self._play_s += dt_s
        if self._play_s > self._motion.pieces[self._piece][1]:
            return self._end_piece(now_ns)
        self._position_m, velocity_m_s = self._motion.at(self._play_s)
        return HandleReading(self._position_m, velocity_m_s, True, recording_time_s=self._play_s)

    def _end_piece(self, now_ns: int) -> HandleReading:
        """Releases the deadman; goes on to the next piece or sets `finished`. Returns the reading at rest."""
        self._piece += 1
        self.person.release(now_ns * 1e-9)
        if self._piece == len(self._motion.pieces):
            self.finished = True
        else:
            self._play_s = self._motion.pieces[self._piece][0]
        return self._wait()


def make_recorded(settings: RecordedHandleSettings, _clock: Clock) -> Playback:
    """Loads the recording of the settings; RecordingError when it can not be used."""
    recording = load_recording(settings.recording, settings.columns.mapping() if settings.columns else None)
    return Playback(RecordedMotion(recording), settings.approach_m_s)
