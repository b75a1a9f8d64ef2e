import numpy as np
import pytest

from forefeel.common.messages import SafetyState
from forefeel.common.recording.recording import Recording
from forefeel.devices.simulated.playback import Playback, RecordedMotion
from forefeel.master.handle import HandleReading, Indication

MS = 1_000_000
S = SafetyState
APPROACH_M_S = 0.03


def recording(time_s: list[float], position_m: list[float]) -> Recording:
    return Recording("test", np.array(time_s), np.array(position_m), None, "test.csv")


RATE = [i * 0.01 for i in range(51)]  # half a second at 100 Hz
GAPPED = recording(
    [*(100.0 + t for t in RATE), *(104.0 + t for t in RATE)],
    [*(0.010 + 0.02 * t for t in RATE), *(0.060 - 0.03 * t for t in RATE)],
)


class Session:
    """A playback at 1 kHz; the slave arms 50 ms after the press, its stage is the command."""

    def __init__(self, motion: RecordedMotion, stage_m: float = 0.03) -> None:
        self.handle = Playback(motion, APPROACH_M_S)
        self.now_ns = 5_000 * MS
        self.stage_m = stage_m
        self.pressed_ms = 0
        self.readings = list[HandleReading]()

    def run(self, seconds: float, state: S | None = None, tick_ns: int = MS) -> list[HandleReading]:
        begin, end_ns = len(self.readings), self.now_ns + round(seconds * 1000) * MS
        while self.now_ns < end_ns:
            self.now_ns += tick_ns
            shown = state or (S.ARMED if self.pressed_ms > 50 else S.READY)
            self.handle.show(Indication(shown, self.stage_m))
            reading = self.handle.read(self.now_ns)
            self.pressed_ms = self.pressed_ms + 1 if reading.deadman else 0
            if reading.deadman and shown is S.ARMED:
                self.stage_m = reading.position_m
            self.readings.append(reading)
        return self.readings[begin:]

    def played(self) -> list[HandleReading]:
        return [reading for reading in self.readings if reading.recording_time_s is not None]


# --- the recorded motion ---


def test_a_recording_is_cut_into_pieces_at_its_gaps() -> None:
    assert RecordedMotion(GAPPED).pieces == [(100.0, 100.5), (104.0, 104.5)]


# --- playback ---


def test_a_stop_in_the_middle_goes_on_at_the_same_time_after_it() -> None:
    motion = RecordedMotion(GAPPED)
    session = Session(motion)
    while len(session.played()) < 200:
        session.run(0.001)
    stopped_s = session.played()[-1].recording_time_s
    assert stopped_s is not None
    session.stage_m += 0.004  # the stage came to rest a little further on
    assert not any(reading.deadman for reading in session.run(0.3, S.STOPPING))
    count = len(session.played())
    session.run(3.0)
    again = session.played()[count]
    assert again.recording_time_s == pytest.approx(stopped_s + 1e-3, abs=1e-9)
    assert again.position_m == motion.at(again.recording_time_s or 0.0)[0]


def test_a_late_tick_skips_no_more_than_fifty_milliseconds() -> None:
    session = Session(RecordedMotion(GAPPED))
    while len(session.played()) < 50:
        session.run(0.001)
    before = session.played()[-1].recording_time_s
    session.run(0.3, tick_ns=300 * MS)
    after = session.played()[-1].recording_time_s
    assert before is not None and after is not None
    assert after - before == pytest.approx(0.050)
