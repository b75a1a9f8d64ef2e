"""A comparison of two clocks, as it is after exchanges over a path whose two ways take equally long."""

from forefeel.common.clock_offset import OffsetEstimate


def compared(offset_ns: int, one_way_ns: int, rate_ppm: float = 0.0) -> OffsetEstimate:
    """`offset_ns`: the peer's clock minus ours."""
    round_trip_ns = 2 * one_way_ns
    return OffsetEstimate(
        offset_ns, one_way_ns, round_trip_ns, round_trip_ns, offset_ns + one_way_ns, rate_ppm
    )
