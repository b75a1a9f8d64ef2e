"""The library's front: recordings, diagnosis, evaluation, prediction, a running cell.

    import forefeel as ff

    rec = ff.load("run.csv")
    d = ff.diagnose(rec)
    print(d)
    e = ff.evaluate(rec, delay_s=0.3)

All quantities are SI; a rotation has rad for m and N m for N.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError, InputError, RecordingError
from forefeel.common.events.text import shown_unit, table_html, units_of
from forefeel.common.model_file import load_model
from forefeel.common.recording.loading import load, load_recording, recordings_in
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Evaluated, prepare
from forefeel.diagnosis.evaluation.evaluate import evaluate as _evaluate
from forefeel.diagnosis.verdict import Cause, VerdictName
from forefeel.results.parallel import in_parallel
from forefeel.results.verdict_text import headline, labelled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from forefeel.diagnosis.confirmation import ConfirmationName, Replay
    from forefeel.diagnosis.diagnose import Diagnosed
    from forefeel.diagnosis.excitation import Limits
    from forefeel.diagnosis.investigation import Investigation as Asked

__all__ = [
    "Cause",
    "Confirmation",
    "Diagnosis",
    "Evaluation",
    "Investigation",
    "Model",
    "diagnose",
    "diagnose_folder",
    "evaluate",
    "investigate",
]


@dataclass(frozen=True, slots=True)
class Model:
    """A contact model, as model.yaml holds it; `sense` is -1 where the recording that it was fitted to counts
    force and position in opposite directions.
    """

    contact: ContactModel
    sense: float = 1.0

    def simulate(self, motion: Any) -> Recording:  # noqa: ANN401 - see `load`
        """The force of the model along the motion of a recording, from rest at its start, as a Recording with
        the same stamps and positions. The motion is conditioned as that of a diagnosis; the contact begins
        anew after each gap. ConfigurationError: a force that is not finite.
        """
        from forefeel.diagnosis.extended_model import simulated_n  # noqa: PLC0415 - as in `diagnose`

        recording, name = _recording(motion), self.contact.name
        force_n = self.sense * simulated_n(self.contact, recording)
        source = f"{name} along {recording.source}"
        return Recording(name, recording.time_s, recording.position_m, force_n, source)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Diagnosis:
    """Errors of a simulation of mass, damper and spring, and their causes; `print` says it in ten lines.

    Attributes:
        recording: what was diagnosed, several as one.
        model: the simulation extended by the causes, where any are named.
        lines: the answer in words.
        details: verdict, causes, intervals, flags and the analysis behind them.
        confirmation: of an answer (`Investigation.judge`): its model on the question; None elsewhere.
    """

    recording: Recording
    model: Model
    lines: tuple[str, ...]
    details: "Diagnosed"
    confirmation: "Confirmation | None" = None

    @property
    def verdict(self) -> VerdictName:
        return self.details.diagnosis.verdict

    @property
    def causes(self) -> tuple[Cause, ...]:
        return self.details.diagnosis.causes

    def confirm(self, recording: Any, as_is: bool = False) -> "Confirmation":  # noqa: ANN401 - see `load`
        """Tests the model on another recording of the bench, for which only zero and phases are fitted anew.

        Raises:
            RecordingError: that can not be diagnosed, or its units are not plausible (`as_is` asks nothing).
        """
        from forefeel.diagnosis.confirmation import confirm  # noqa: PLC0415 - as in `diagnose`
        from forefeel.results.task import require_usable  # noqa: PLC0415

        other = _recording(recording, force=True)
        with units_of(other.columns), threadpool_limits(1):
            require_usable(other, as_is)
            return _confirmation(confirm(self.details, other))

    def __str__(self) -> str:
        """The first line of each part of the answer, without what plain regressions saw before the search."""
        shown, label = list[str](), ""
        for line in self.lines:
            label = line.split(" ")[0] or label
            if label != "Look" and (line[0] != " " or label == "Rivals"):
                shown.append(line)
        return "\n".join(shown)

    __repr__ = __str__  # a notebook shows what a cell ends with

    def _repr_html_(self) -> str:
        return table_html(str(self))

    def plot(self) -> "Figure | PageFigure":
        """Figure of matplotlib, neither shown nor saved: force over time as measured, simulated and extended,
        and below what the latter two leave of it. Without matplotlib the figure of the diagnosis's page.
        """
        try:
            from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
        except ImportError:
            from forefeel.results.page import render_figure  # noqa: PLC0415 - as in `diagnose`

            return PageFigure(render_figure(self.details))
        from forefeel.results.curves import Curves  # noqa: PLC0415 - as in `diagnose`

        curves = Curves.of(self.details.analysis, None)
        t, rows = curves.t[curves.rows], curves.rows
        figure = Figure(figsize=(9.0, 5.0), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(t, curves.force[rows], "k.", markersize=2, label="measured")
        for name, force_n in (("simulation", curves.simulated), ("extended", curves.extended)):
            above.plot(t, force_n[rows], linewidth=1, label=name)
            below.plot(t, (curves.force - force_n)[rows], linewidth=1, label=f"left by {name}")
        with units_of(self.recording.columns):
            above.set(title=headline(self.details.diagnosis), ylabel=f"force, {shown_unit('N')}")
            below.set(xlabel="time, s", ylabel=f"left, {shown_unit('N')}")
        above.legend()
        return figure


@dataclass(frozen=True, slots=True, repr=False)
class PageFigure:
    """A figure as the page of a diagnosis has it, which a notebook shows."""

    html: str

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" style="width:100%;height:640px;border:0"></iframe>'

    def savefig(self, path: str | Path) -> None:
        """Writes a page with the figure. ConfigurationError: the file is to be an image."""
        if Path(path).suffix.lower() not in (".html", ".htm"):
            raise ConfigurationError(f"{path}: an image needs matplotlib: pip install 'forefeel[plot]'")
        Path(path).write_text(self.html, encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Confirmation:
    """A model on another recording than its own; `print` says it in three lines.

    Attributes:
        lines: the answer in words.
        details: numbers, see `forefeel.diagnosis.confirmation.Confirmation`, and the forces compared.
    """

    lines: tuple[str, ...]
    details: "Replay"

    @property
    def verdict(self) -> "ConfirmationName":
        return self.details.confirmation.verdict

    @property
    def ratio(self) -> float:
        """Rms that the model leaves there over what is to be expected."""
        return self.details.confirmation.ratio

    def __str__(self) -> str:
        return "\n".join(self.lines)

    __repr__ = __str__


def _confirmation(replay: "Replay") -> Confirmation:
    from forefeel.results.confirmation_text import confirmation_lines  # noqa: PLC0415 - as in `diagnose`

    return Confirmation(labelled(confirmation_lines(replay)), replay)


def diagnose(
    recording: Any,  # noqa: ANN401 - see `load`
    *beside: Any,  # noqa: ANN401
    model: str | Path | None = None,
    as_is: bool = False,
) -> Diagnosis:
    """Finds what the simulation of a recording gets wrong, and which causes explain it.

    Args:
        recording: a `Recording`, or what `load` takes; or a list of those.
        beside: further recordings of the same bench, for one answer to all.
        model: model.yaml of the simulation to compare with, in place of a fitted mass, damper and spring.
        as_is: asks nothing about units.

    Raises:
        RecordingError: it can not be diagnosed, or its units are not plausible.
    """
    given = None if model is None else load_model(Path(model))
    sources = [*(recording if isinstance(recording, list) else [recording]), *beside]
    if not sources:
        raise RecordingError("no recording: expected at least one")
    from forefeel.results.task import answered  # noqa: PLC0415 - scipy: 85 MB that an evaluation does not need

    recordings = [_recording(source, force=True) for source in sources]
    with threadpool_limits(1):  # the arrays are small, and threads would wait
        answer = answered(recordings, given=given, as_is=as_is)
    extended = Model(answer.model, answer.details.analysis.regression.sense)
    return Diagnosis(answer.details.recording, extended, answer.lines, answer.details)


def diagnose_folder(
    folder: str | Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    model: str | Path | None = None,
    as_is: bool = False,
) -> Iterator[tuple[Path, Diagnosis | InputError]]:
    """Yields each recording file of a folder with its diagnosis, or the error that prevents one, in any
    order.

    Args:
        folder: its files of `SUFFIXES` are diagnosed.
        jobs: how many at a time, each in a process: a script needs `if __name__ == "__main__":`.
        scheduler: address of a dask cluster that does it, such as `tcp://10.0.0.2:8786`.
        model, as_is: as of `diagnose`.

    Raises:
        ConfigurationError: no recording in the folder.
        EndpointError: no cluster at that address.
        RunError: a worker has died.
    """
    attempt = partial(_attempt, None if model is None else Path(model).resolve(), as_is)
    files = recordings_in(Path(folder).resolve())
    if jobs == 1 and scheduler is None:
        return map(attempt, files)
    return in_parallel(attempt, files, jobs, scheduler)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Investigation:
    """The motion that a recording leaves to be made; `print` says it in some lines.

    Attributes:
        motion: to be played, without a force, at 1 kHz from 0 s on.
        lines: in words, with what each rival says of it.
        details: limits, forecasts, the diagnosis of the recording.
    """

    motion: Recording
    lines: tuple[str, ...]
    details: "Asked"

    def judge(self, answer: Any, as_is: bool = False) -> Diagnosis:  # noqa: ANN401 - see `load`
        """Diagnoses the recording of the motion and tests that model on the first recording; the verdict is
        `unexplained` where the model fails there.

        Raises:
            RecordingError: it can not be diagnosed, or its units are not plausible (`as_is` asks nothing).
        """
        from forefeel.diagnosis.investigation import judge  # noqa: PLC0415 - as in `diagnose`
        from forefeel.results.investigation import answer_lines  # noqa: PLC0415
        from forefeel.results.task import model_of, require_usable  # noqa: PLC0415

        recording = _recording(answer, force=True)
        with units_of(recording.columns), threadpool_limits(1):
            require_usable(recording, as_is)
            judged = judge(self.details, recording)
            replay, details = judged.replay, judged.diagnosed
            confirmed = None if replay is None else _confirmation(replay)
        model = Model(model_of(details), details.analysis.regression.sense)
        return Diagnosis(details.recording, model, tuple(answer_lines(judged)), details, confirmed)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    __repr__ = __str__


def investigate(
    recording: Any,  # noqa: ANN401 - a `Diagnosis`, or see `load`
    *,
    limits: "Limits | None" = None,
    seconds: float = 20.0,
) -> Investigation:
    """Makes the motion to record next: one that settles most of what a poor first recording leaves open.

    Args:
        recording: a `Diagnosis`, a `Recording`, or what `load` takes.
        limits: of the bench; None: what the recording has reached.
        seconds: of the motion, 10 to 60.

    Raises:
        RecordingError: it has no force, no motion, or is shorter than 3 s.
        ConfigurationError: another duration.
    """
    from forefeel.diagnosis.investigation import investigate as ask  # noqa: PLC0415 - as in `diagnose`
    from forefeel.results.investigation import question_lines  # noqa: PLC0415

    question = recording.details if isinstance(recording, Diagnosis) else _recording(recording, force=True)
    with threadpool_limits(1):
        asked = ask(question, {} if limits is None else asdict(limits), seconds)
    return Investigation(asked.motion, tuple(question_lines(asked)), asked)


def _attempt(model: Path | None, as_is: bool, file: Path) -> tuple[Path, Diagnosis | InputError]:
    try:
        return file, diagnose(file, model=model, as_is=as_is)
    except InputError as error:
        return file, error


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Evaluation:
    """Errors of each method that predicts the force across a delay; `print` gives a table.

    Attributes:
        delay_s: from a motion to the arrival of its force.
        rms_n: error of each method in N, None where it diverged; `zoh` is the newest force that has arrived.
        details: scores, predictions and the parts of the motion.
    """

    delay_s: float
    rms_n: Mapping[str, float | None]
    details: Evaluated

    @property
    def ratio(self) -> float | None:
        """The error of the prediction over that of the zero-order hold."""
        predicted_n, held_n = self.rms_n["forefeel"], self.rms_n["zoh"]
        return predicted_n / held_n if predicted_n is not None and held_n else None

    def __str__(self) -> str:
        with units_of(self.details.prepared.recording.columns):
            unit = shown_unit("N")
        sizes = ("diverged" if rms_n is None else f"{rms_n:.4g} {unit} rms" for rms_n in self.rms_n.values())
        rows = [f"{name:<10} {size}" for name, size in zip(self.rms_n, sizes, strict=True)]
        return "\n".join([f"{self.delay_s:g} s late", *rows])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return table_html(str(self))


def evaluate(
    recording: Any,  # noqa: ANN401 - see `load`
    delay_s: float = 0.3,
    *,
    jitter_s: float = 0.0,
    loss: float = 0.0,
    seed: int = 0,
    model: str | Path | None = None,
) -> Evaluation:
    """Predicts the force of a recording from its motion and the forces that have arrived, stamp by stamp.

    Args:
        recording: a `Recording`, or what `load` takes.
        delay_s, jitter_s, loss, seed: of the link; each force is up to `jitter_s` earlier or later.
        model: model.yaml for the prediction.

    Raises:
        RecordingError: no force, or too short.
    """
    given = None if model is None else load_model(Path(model))
    prepared = prepare(_recording(recording, force=True), DelayedLink(delay_s, jitter_s, loss, seed), given)
    details = _evaluate(prepared, given)
    return Evaluation(delay_s, {name: score.size.rms_n for name, score in details.scores.items()}, details)


def _recording(source: Any, force: bool | None = None) -> Recording:  # noqa: ANN401 - see `load`
    if isinstance(source, Recording):
        return source
    return load_recording(Path(source), force=force) if isinstance(source, str | Path) else load(source)
