import os
import threading

import pytest

from forefeel.common.runtime.threads import in_thread


def test_the_work_is_done_beside_and_inherits_the_scheduling_of_who_asks_for_it() -> None:
    """SCHED_BATCH takes no permission. Each thread has a scheduling of its own, so that the test's stays."""
    found: list[tuple[int, int, bool]] = []

    def ask() -> None:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        asked = in_thread(
            lambda: (os.sched_getscheduler(0), threading.get_ident(), threading.current_thread().daemon),
            "work",
        )
        found.append(asked.result(5.0))

    asker = threading.Thread(target=ask)
    asker.start()
    asker.join()
    ((policy, ident, daemon),) = found
    assert (policy, daemon) == (os.SCHED_BATCH, True)
    assert ident not in {threading.get_ident(), asker.ident}


def test_what_it_raises_is_raised_where_the_result_is_asked_for() -> None:
    with pytest.raises(ZeroDivisionError):
        in_thread(lambda: 1 // 0, "work").result(5.0)
