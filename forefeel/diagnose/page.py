"""report.html of a diagnosis."""

from common.recording.recording import Recording
from diagnosis.diagnose import Diagnosed
from diagnosis.diagnose.prediction import Across
from forefeel.diagnose.figures import drawings
from forefeel.diagnose.words import answer, plain, shown
from forefeel.report.template import render


def render_page(recording: Recording, diagnosed: Diagnosed, across: Across | None) -> str:
    """The diagnosis with its figures as one HTML file that needs nothing else."""
    return render(
        "diagnose/page.html.j2",
        recording=recording,
        diagnosis=diagnosed.diagnosis,
        across=across,
        lines=answer(recording, diagnosed.diagnosis, across)[:-1],
        plain=plain,
        shown=shown,
        drawings=drawings(recording.name, diagnosed.analysis),
    )
