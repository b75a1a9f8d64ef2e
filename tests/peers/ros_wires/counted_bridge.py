"""`forefeel ros` that also writes down the stamps that it sends: `counted_bridge OUT WORDS...`."""

import atexit
import json
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

from forefeel.__main__ import run
from forefeel.ros.cdr import RosType
from forefeel.ros.crtk import Advertise, RosFeed, Send
from tests.peers.ros_wires import AXIS, CELL

stamps: defaultdict[str, list[int]] = defaultdict(list)


def counted(advertise: Advertise) -> Advertise:
    """Adds a note of each stamp to the publishers."""

    def advertised(topic: str, kind: RosType) -> Send:
        sent, send = stamps[topic.removeprefix(f"/{CELL}/{AXIS}/")], advertise(topic, kind)

        def both(payload: bytes, stamp_ns: int) -> None:
            sent.append(stamp_ns)
            send(payload, stamp_ns)

        return both

    return advertised


def main() -> None:
    out, begin = Path(sys.argv.pop(1)), RosFeed.__init__

    def begin_counted(
        feed: RosFeed, cell: str, rate_hz: float, epoch_ns: Callable[[int], int], advertise: Advertise
    ) -> None:
        begin(feed, cell, rate_hz, epoch_ns, counted(advertise))

    atexit.register(lambda: out.write_text(json.dumps(stamps)))
    with patch.object(RosFeed, "__init__", begin_counted):
        run()


if __name__ == "__main__":
    main()
