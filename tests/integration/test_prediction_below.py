"""The force prediction where packets are lost and delayed below Zenoh."""

from pathlib import Path

import pytest

from tests.net.hosts import needs_root
from tests.net.prediction import CABLE, scored

pytestmark = [*needs_root, pytest.mark.soak, pytest.mark.timeout(120)]


def test_over_datagrams_the_prediction_beats_the_hold_and_nothing_stops(tmp_path: Path) -> None:
    report, packets = scored(tmp_path, "udp", 20.0, **CABLE)
    lost = packets["ab"]["lost"] / packets["ab"]["offered"]
    assert lost == pytest.approx(CABLE["loss"], rel=0.5)
    assert report.delay_s.p50 == pytest.approx(2 * CABLE["delay_s"], abs=0.010)
    assert report.armed_share is not None and report.armed_share > 0.9
    assert report.commands.scored > 10_000
    assert report.ratio.rms is not None and report.ratio.rms < 0.75


def test_over_several_tls_connections_the_service_stays_armed(tmp_path: Path) -> None:
    """With certificates, access control and the watchdog as it is by default."""
    report, packets = scored(tmp_path, "tls-x8", 20.0, **CABLE)
    assert packets["ab"]["lost"] / packets["ab"]["offered"] == pytest.approx(CABLE["loss"], rel=0.5)
    assert report.armed_share is not None and report.armed_share > 0.9
    assert report.delay_s.p99 is not None and report.delay_s.p99 < 0.125
    assert report.ratio.rms is not None and report.ratio.rms < 0.75
