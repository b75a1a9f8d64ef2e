"""`forefeel investigate`: the motion to record next, the verdict on its answer, or both on a bench."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from forefeel.common.errors import ConfigurationError
from forefeel.common.events.text import quantity
from forefeel.common.recording.recording import Recording, joined
from forefeel.diagnosis.excitation import ForceLimitMet, Limits, play_excitation
from forefeel.diagnosis.investigation import Investigation, investigate, judge
from forefeel.files import fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.results.investigation import (
    ANSWER,
    ANSWER_FILES,
    QUESTION,
    QUESTION_FILES,
    answer_lines,
    answer_texts,
    question_lines,
    question_texts,
)
from forefeel.results.run import stages
from forefeel.terminal import answer, say, suggest

if TYPE_CHECKING:  # daemons and network, which a file needs none of
    from forefeel.investigation.bench import LiveBench, SimulatedBench

_EARLIER = "an earlier investigation"
_APART_S = 2.0  # between two parts of an answer: nothing goes on across it


@dataclass(frozen=True, slots=True)
class InvestigationOptions:
    """Options of an investigation: duration in s and `limits` of its motion, see `investigate`. `read` raises
    InputError for a recording that can not be used.
    """

    read: Callable[[Path], Recording]
    duration_s: float
    limits: Mapping[str, float]
    overwrite: bool = False
    yes: bool = False


def run_investigation(files: Sequence[Path], out: Path | None, options: InvestigationOptions) -> None:
    """Makes the motion to record next after the first of `files`, or, where a second is the record of that
    motion, judges it; prints the result and writes it into `out`, by default `<stem of the first>-asked`.

    Raises:
        InputError: a recording can not be used, or more than two; nothing was written.
        RunError: interrupted, or the results can not be written.
    """
    if len(files) > 2:
        raise ConfigurationError(f"{files[2]}: a third recording; expected a question, and an answer to it")
    question, *answers = files
    out = out or Path(f"{question.stem}-asked")
    with ends_in_order("investigation", out) as written, threadpool_limits(1):
        fresh_folder(out, ANSWER_FILES if answers else QUESTION_FILES, _EARLIER, options.overwrite)
        recordings = [options.read(file) for file in files]
        asked = investigate(recordings[0], options.limits, options.duration_s, stages(question.stem))
        if answers:
            _judge(asked, recordings[1], out, written)
            return
        texts = question_texts(asked)
        write_all(out, texts, written)
        answer(*question_lines(asked), f"{', '.join(texts)} in {out}", document=lambda: texts[QUESTION])
    if not options.limits:
        wider = "--workspace, --max-speed, --max-acceleration, --max-force"
        say(f"within what {question.name} has reached; the limits of the bench tell more: {wider}")
    suggest("investigate", question, "answer.csv", head="with the answer", out=out)


def run_on_bench(
    bench: "SimulatedBench | LiveBench", question: Path | None, out: Path, options: InvestigationOptions
) -> None:
    """Records the first recording where `question` is None, works out the motion, plays it (each time that
    the force limit ends it, what is left of it) and judges the records of that; prints the result and writes
    it into `out`. Narrows `bench.limits` by the options. A live bench asks for consent first.

    Raises:
        InputError: limits beyond those of the settings, or a recording that can not be used.
        RunError: not confirmed, stopped, or interrupted; recordings stay, and there is no verdict.
    """
    bench.limits = _within(bench.limits, options.limits)
    with ends_in_order("investigation", out) as written, threadpool_limits(1):
        fresh_folder(out, (*QUESTION_FILES, *ANSWER_FILES), _EARLIER, options.overwrite)
        bench.ask(options.yes)
        if question is None:
            question = out / "question.mcap"
            bench.record_question(question, options.duration_s)
            written.append(question.name)
        asked = investigate(
            options.read(question), asdict(bench.limits), options.duration_s, stages(question.stem)
        )
        parts: list[Recording] = []

        def play(motion: Recording, _limits: Limits) -> ForceLimitMet | None:
            """Plays and records one part of the answer, appends it to `parts`; prints and returns where the
            force limit ended it.
            """
            name = f"answer-{len(parts) + 1}.mcap"
            say(f"playing {motion.duration_s:.0f} s: {name}")
            met = bench.play(motion, out / name)
            written.append(name)
            parts.append(options.read(out / name))
            if met is not None:
                place = quantity(met.position_m, "m")
                say(f"the force limit was met at {place}; what is left is played up to there")
            return met

        play_excitation(asked.limits, options.duration_s, asked.question.rate_hz, play)
        write_all(out, question_texts(asked), written)
        whole = replace(joined(parts, _APART_S), name="answer", source=parts[0].source, further=())
        _judge(asked, whole, out, written)


def _judge(asked: Investigation, recording: Recording, out: Path, written: list[str]) -> None:
    judged = judge(asked, recording, stages(recording.name))
    texts = answer_texts(asked, recording, judged)
    write_all(out, texts, written)
    answer(*answer_lines(judged), f"{', '.join(texts)} in {out}", document=lambda: texts[ANSWER])


def _within(bench: Limits, limits: Mapping[str, float]) -> Limits:
    """The limits of a bench, narrowed by options. ConfigurationError: one is beyond them."""
    for key, limit in limits.items():
        most = getattr(bench, key)
        if limit < most if key == "low_m" else limit > most:
            raise ConfigurationError(
                f"{key} = {limit:g}: expected within {most:g}, the limit of the settings"
            )
    return replace(bench, **limits)
