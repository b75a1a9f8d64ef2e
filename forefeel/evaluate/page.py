"""evaluation.html."""

from collections.abc import Mapping, Sequence

from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Evaluated
from forefeel.diagnosis.evaluation.methods import METHODS
from forefeel.evaluate.figures import drawings
from forefeel.evaluate.table import best, ratio_to_hold
from forefeel.report.template import render


def render_page(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated], skipped: Mapping[str, str]
) -> str:
    """The evaluation with figures as one HTML file that needs nothing else."""
    return render(
        "evaluate/page.html.j2",
        link=link,
        rules=rules,
        recordings=recordings,
        skipped=skipped,
        methods=list(METHODS),
        best=best,
        ratio_to_hold=ratio_to_hold,
        drawings=drawings,
    )
