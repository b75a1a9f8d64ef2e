"""What is said while somebody is waited for: the cause every 5 s, with fakes in the place of the network."""

from collections.abc import Sequence
from threading import Event
from typing import cast

import pytest

from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.reaching import Obstacle
from forefeel.waiting import Obstacles, Waiting, in_words, unheard

S = 1_000_000_000
SILENT = Obstacle("no answer from 10.0.0.2:7447", "check the cable", silent=True)
REFUSED = Obstacle("10.0.0.3:7447 refuses the connection", "start the slave there")


class FakeObstacles:
    """Finds what a test says, once it lets it."""

    def __init__(self, *found: Obstacle) -> None:
        self.found: Sequence[Obstacle] = found
        self.may_end = Event()
        self.trials = 0

    def find(self) -> list[Obstacle]:
        self.trials += 1
        assert self.may_end.wait(5.0)
        return list(self.found)


class Bench:
    """A wait whose clock a test turns on."""

    def __init__(self, *found: Obstacle) -> None:
        self.obstacles = FakeObstacles(*found)
        self.told: list[str] = []
        self.waiting = Waiting(
            cast(Obstacles, self.obstacles), lambda: "connected, but silent", self.told.append
        )

    def look(self, at_s: float, known: str = "") -> None:
        """A look, after which a trial that it began has ended."""
        self.waiting.look(round(at_s * S), known)
        trial = self.waiting._trial
        if trial is not None and self.obstacles.may_end.is_set():
            trial.result(5.0)


def test_the_cause_is_looked_for_and_told_every_five_seconds_with_the_time() -> None:
    bench = Bench(SILENT)
    bench.obstacles.may_end.set()
    for tenth in range(1, 161):
        bench.look(tenth / 10)
    assert bench.told == [
        f"no answer from 10.0.0.2:7447 for {waited}" for waited in ("5.1 s", "10 s", "15 s")
    ]
    assert bench.obstacles.trials == 3
    assert bench.waiting.found == bench.told[-1]


def test_one_trial_runs_at_a_time_and_nobody_waits_for_it() -> None:
    bench = Bench(REFUSED)
    for at_s in range(30):
        bench.look(at_s)
    assert (bench.told, bench.obstacles.trials) == ([], 1)
    bench.obstacles.may_end.set()
    bench.look(30)
    bench.look(31)
    assert bench.told[0].startswith("10.0.0.3:7447 refuses the connection: start the slave there (3")


def test_a_cause_that_is_known_is_told_without_a_trial() -> None:
    bench = Bench(REFUSED)
    for at_s in range(8):
        bench.look(at_s, "the slave refuses: another session holds the lease")
    assert bench.told == ["the slave refuses: another session holds the lease (5.0 s)"]
    assert (bench.obstacles.trials, bench.waiting.found) == (0, "")


def test_a_trial_that_ends_when_somebody_is_heard_is_not_told() -> None:
    bench = Bench(REFUSED)
    for at_s in (0, 5):
        bench.look(at_s)
    bench.waiting.over()
    bench.obstacles.may_end.set()
    for at_s in (20, 21):  # another wait
        bench.look(at_s)
    assert (bench.told, bench.waiting.found) == ([], "")


def test_what_is_wrong_where_nothing_is_in_the_way() -> None:
    bench = Bench()
    bench.obstacles.may_end.set()
    for at_s in (0, 5, 6):
        bench.look(at_s)
    assert bench.told == ["connected, but silent (6.0 s)"]
    assert bench.waiting.try_now(9 * S) == "connected, but silent (9.0 s)"


def test_several_obstacles_stand_in_one_line() -> None:
    assert in_words([SILENT, REFUSED], "12 s") == (
        "no answer from 10.0.0.2:7447 for 12 s; "
        "10.0.0.3:7447 refuses the connection: start the slave there (12 s)"
    )


@pytest.mark.parametrize(
    ("transport", "connected", "said"),
    [
        ({"connect": ["tls/10.0.0.2:7447"]}, True, "10.0.0.2:7447 is connected, but no slave"),
        (
            {"connect": ["tls/10.0.0.2:7447"]},
            False,
            "10.0.0.2:7447 accepts connections, but none of Zenoh opens",
        ),
        ({"listen": ["tls/0.0.0.0:7447"]}, False, "nobody has connected to 0.0.0.0:7447"),
    ],
)
def test_an_end_that_is_not_heard(transport: dict[str, object], connected: bool, said: str) -> None:
    assert unheard(TransportSettings.model_validate(transport), connected, "no slave") == said


def test_an_endpoint_that_can_not_be_tried_is_silent() -> None:
    obstacles = Obstacles(
        TransportSettings(connect=("quic/10.0.0.2:7447",)), Party("master", ("cell",)), "slave"
    )
    assert [each.what for each in obstacles.find()] == ["no answer from 10.0.0.2:7447"]
