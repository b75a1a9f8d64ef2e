"""The emulated Zaber stage: what it answers, and that its motion keeps its own limits."""

import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from forefeel.devices.zaber.protocol import Alert, CommandEncoder, Message, Parser, Reply

UNHOMED = ZaberModel(homed=False, start_m=0.02)


class Host:
    """Talks to the device in virtual time."""

    def __init__(self, model: ZaberModel = ZaberModel()) -> None:  # noqa: B008 - frozen
        self.steps: list[tuple[float, float, float, float]] = []
        self.device = ZaberDevice(model, lambda *step: self.steps.append(step))
        self.t_s = 0.0
        self._encoder, self._parser = CommandEncoder(1), Parser(checksums=False)

    def raw(self, data: bytes, after_s: float = 0.0) -> list[Message]:
        self.device.receive(data, self.t_s)
        self.t_s += after_s
        return self._parser.feed(self.device.advance(self.t_s))

    def ask(self, text: str, axis: int = 1, after_s: float = 0.0) -> Reply:
        found = self.raw(self._encoder.encode(axis, text)[1], after_s)[0]
        assert isinstance(found, Reply)
        return found


@pytest.mark.parametrize(
    ("axis", "text", "reason"),
    [
        (1, "bogus", "BADCOMMAND"),
        (1, "move sideways 1", "BADCOMMAND"),
        (1, "get nothing", "BADCOMMAND"),
        (1, "set nothing 1", "BADCOMMAND"),
        (2, "get pos", "BADAXIS"),
        (1, "set comm.alert 1", "DEVICEONLY"),
        (0, "set comm.alert 2", "BADDATA"),
        (1, "set version 8", "BADDATA"),
        (1, "set maxspeed 0", "BADDATA"),
        (1, "move abs 1000001", "BADDATA"),
        (1, "move rel -1", "BADDATA"),
        (1, "move abs 1e3", "BADDATA"),
        (1, "move abs", "BADDATA"),
        (1, "home 1", "BADDATA"),
    ],
)
def test_what_it_rejects(axis: int, text: str, reason: str) -> None:
    host = Host()
    found = host.ask(text, axis)
    assert (found.accepted, found.data, found.busy) == (False, reason, False)


def test_damaged_foreign_and_unchecked_commands() -> None:
    host = Host()
    assert host.raw(b"/1 1 05 move abs 100:00\n") == []
    assert host.raw(b"/2 1 05 get pos\n") == []
    assert host.raw(b"get pos\n\xff\xfe\n") == []
    assert host.device.counts["ignored"] == 3
    assert host.raw(b"/1 1 05 get pos\n/0 0 06 get pos\n/\n/1 get pos\n") == [
        Reply(1, 1, 5, True, False, "", "0"),
        Reply(1, 0, 6, True, False, "", "0"),
        Reply(1, 0, None, True, False, "", "0"),
        Reply(1, 0, None, True, False, "", "0"),
    ]


def test_replies_carry_checksums_once_that_is_set() -> None:
    host = Host()
    host.device.receive(b"/1 0 01 set comm.checksum 1\n", 0.0)
    assert host.device.advance(0.0) == b"@01 0 01 OK IDLE -- 0:0C\r\n"


def test_a_motion_takes_the_time_of_its_trapezoid_and_keeps_speed_and_acceleration() -> None:
    host = Host()
    speed, acceleration, way = 0.05, 1.0, 0.03  # m, s: what it has from the factory
    host.ask("set comm.alert 1", axis=0)
    end_s = way / speed + speed / acceleration
    host.ask("move abs 300000")
    host.t_s = end_s - 0.01
    assert host.ask("").busy
    host.t_s = end_s + 0.01
    assert Alert(1, 1, False, "", "") in host.raw(b"")
    assert host.ask("get pos").data == "300000"
    x, v, a = zip(*(step[1:] for step in host.steps), strict=True)
    assert max(v) == pytest.approx(speed, rel=1e-4) and max(map(abs, a)) == pytest.approx(
        acceleration, rel=1e-3
    )
    assert max(x) <= way + 1e-12 and sum(v) * 1e-3 == pytest.approx(x[-1])


def test_targets_that_change_on_the_way_interrupt_and_are_reached_without_leaving_the_limits() -> None:
    host = Host()
    for goal in (900_000, 10, 500_000, 0, 1_000_000, 3):
        host.ask(f"move abs {goal}", after_s=0.3)
    assert "NI" in host.ask("warnings").data
    host.t_s += 3.0
    assert host.ask("get pos").data == "3"
    assert min(step[1] for step in host.steps) >= -1e-12
    assert max(abs(step[3]) for step in host.steps) <= 1.0 + 1e-3


def test_velocity_runs_to_the_limit_and_stops_there() -> None:
    host = Host()
    host.ask("move vel 1000000", after_s=3.0)
    found = host.ask("get pos")
    assert (found.data, found.busy) == ("1000000", False)
    host.ask("move vel -100000", after_s=0.2)
    assert host.ask("stop", after_s=0.1).accepted
    where = host.ask("get pos", after_s=0.5)
    assert where == Reply(1, 1, where.message_id, True, False, "NI", host.ask("get pos").data)


def test_unhomed_it_says_so_until_it_is_homed() -> None:
    host = Host(UNHOMED)
    assert host.ask("get pos").warning == "WR" and host.ask("get pos").data == "0"
    assert host.device.motion()[0] == pytest.approx(0.02)
    host.ask("home", after_s=3.0)
    assert host.ask("warnings").data == "00"
    assert host.device.motion()[0] == pytest.approx(0.0, abs=1e-9)
    host.device.provoke("power_cycle")
    assert host.ask("warnings").data == "01 WR"
    host.ask("set pos 0")
    assert host.ask("warnings").data == "01 WH"


def test_unknown_faults_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="expected drive_fault, stuck"):
        ZaberDevice().provoke("overrange")
