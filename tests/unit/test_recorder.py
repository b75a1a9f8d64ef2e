"""Messages that a recorder did not hear are counted by the numbers of those that it did."""

import pytest

from forefeel.common.topics import FORCE
from forefeel.recorder import Missing
from tests.messages import usual


@pytest.mark.parametrize(
    ("heard", "count"),
    [
        ([(7, 1), (7, 2), (7, 3)], 0),
        ([(7, 1), (7, 22), (7, 23), (7, 43)], 39),  # batches of 20 and of 19
        ([(7, 40), (7, 1), (7, 2)], 0),  # a slave that was started anew
        ([(7, 40), (8, 60), (8, 62)], 1),  # between two sessions none is expected
    ],
)
def test_what_was_not_heard_is_counted(heard: list[tuple[int, int]], count: int) -> None:
    missing = Missing()
    for session_id, sequence in heard:
        missing.hear("a", usual(FORCE, session_id=session_id, sequence=sequence))
        missing.hear("b", usual(FORCE, session_id=1, sequence=1))
    assert missing.count == count
