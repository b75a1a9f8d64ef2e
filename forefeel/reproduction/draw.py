"""Every figure of the page."""

from forefeel.diagnosis.reproduction.assemble import Traces
from forefeel.diagnosis.reproduction.results import Reproduction
from forefeel.reproduction.drawing import Picture
from forefeel.reproduction.figures import bench_pictures, simulated_pictures
from forefeel.reproduction.flaws import (
    baseline_picture,
    identifiability_picture,
    memory_picture,
    pairing_picture,
    threshold_picture,
    unmodelled_picture,
    windup_picture,
)


def draw_all(numbers: Reproduction, traces: Traces) -> list[Picture]:
    """Figures 4, 5, 7 to 10, the six flaws, the thresholds."""
    flaws = numbers.flaws
    pictures = simulated_pictures(*traces.simulated)
    for bench, made in zip(traces.bench, numbers.bench, strict=True):
        pictures += bench_pictures(bench, made)
    return [
        *pictures,
        identifiability_picture(flaws.unidentifiable, traces.amplitudes),
        windup_picture(traces.windup),
        memory_picture(flaws.memory, traces.memory),
        unmodelled_picture(traces.unmodelled),
        baseline_picture(flaws.baseline.rows),
        pairing_picture(flaws.baseline.rows, traces.simulated[1]),
        threshold_picture(numbers.thresholds),
    ]
