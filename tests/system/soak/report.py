"""The soak as a row: the service among random faults; memory, recordings, motion, arming again."""

from pathlib import Path

from tests.live_cell import LiveCell
from tests.system.rows import Result
from tests.system.soak.recordings import check
from tests.system.soak.schedule import schedule
from tests.system.soak.service import Soak

MOST_GROWTH = 0.05
_SEED = 1


def soak(minutes: float, folder: Path) -> Result:
    with LiveCell(folder) as cell:
        run = Soak(cell, _SEED)
        run.run(schedule(_SEED, 60.0 * minutes), 60.0 * minutes)
        wrong = [*run.problems, *map(str, cell.faults)]
        figures = [f"{len(run.done)} faults, armed again after {max(done.back_s for done in run.done):.1f} s"]
        for life in run.lives:
            if (found := life.growth()) is not None:
                resident_mb, share, span_s = found
                figures.append(f"{life.name} {resident_mb:.0f} MB {share:+.1%}")
                if share > MOST_GROWTH:
                    wrong.append(f"{life.name} grew by {share:.1%} in {span_s:.0f} s")
        disturbed = [(done.from_ns, done.to_ns) for done in run.done]
        for taken in run.taken:
            messages, faulty = check(taken.path, taken.killed, disturbed)
            figures.append(f"{messages} messages in {taken.path.name}")
            wrong += [f"{taken.path.name}: {each}" for each in faulty]
        wrong += [f"moved outside ARMED by {each}" for each in run.motion.moved[:3]]
        figures.append(f"{run.motion.resting} forces while nothing was followed")
        return Result("; ".join(figures), wrong)
