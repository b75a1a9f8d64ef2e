"""Recordings put to whichever forefeel is importable; the only module here that imports the product."""

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

NAMED = ("cause_found", "partly_explained")
_SCHEMA = "forefeel.model/1"
_SIMULATED_S, _STEPS = 60.0, 200_000


def answers(folders: list[Path], jobs: int, product: Path | None) -> Iterator[dict[str, Any]]:
    """The answer to each folder's a.csv, in their order; `product`: the checkout to ask."""
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(partial(answered, product=product), folders)


def answered(folder: Path, product: Path | None = None) -> dict[str, Any]:
    """What is said of one recording; an exception is an answer, too."""
    if product is not None and sys.path[0] != str(product):
        sys.path.insert(0, str(product))
    import forefeel as ff  # the checkout is only known here

    start = process_time()
    answer: dict[str, Any] = {"name": folder.name}
    try:
        first = _loaded(ff, folder / "a.csv")
        try:
            found = ff.diagnose(first)
        except ff.UnclearError as error:  # a rate or a force that is true
            answer["asked"] = str(error)
            found = ff.diagnose(first, as_is=True)
    except Exception as error:  # noqa: BLE001 - whatever goes wrong is counted
        verdict = "refused" if isinstance(error, ff.ForefeelError) else "exception"
        return {**answer, "verdict": verdict, "error": f"{type(error).__name__}: {error}", "causes": []}
    answer |= _said(found.details.diagnosis) | {"seconds": process_time() - start, "lines": list(found.lines)}
    if answer["verdict"] in NAMED and any(cause["name"] != "bias" for cause in answer["causes"]):
        try:
            answer |= _carried(ff, found, first, folder)
        except Exception as error:  # noqa: BLE001
            answer["not_carried"] = f"{type(error).__name__}: {error}"
    return answer


def _loaded(ff: Any, path: Path) -> Any:  # noqa: ANN401
    """A recording; with further columns, of which one may be a force, too, says which are the stage's."""
    with path.open() as file:
        _, position, force, *further = file.readline().strip().split(",")
    if not further:
        return ff.load(path)
    return ff.load(path, position=f"{'mm' if 'mm' in position else 'm'}:{position}", force=f"N:{force}")


def _said(d: Any) -> dict[str, Any]:  # noqa: ANN401 - of one of several versions
    def interval(each: Any) -> list[float]:  # noqa: ANN401
        return [each.value, each.low, each.high]

    return {
        "verdict": d.verdict,
        "causes": [
            {
                "name": cause.name,
                "gain_n": cause.gain_n,
                "explained_n": cause.explained_n,
                "parameters": {key: interval(each) for key, each in cause.parameters.items()},
            }
            for cause in d.causes
        ],
        "base": {key: interval(each) for key, each in d.extended.intervals.items()},
        "gain": [d.held_out.gain, d.held_out.gain_low, d.held_out.gain_high],
        "elsewhere": d.other_motion
        and [d.other_motion.gain, d.other_motion.gain_low, d.other_motion.gain_high],
        "rivals": [list(rival) for rival in d.rivals],
        "before_n": d.held_out.rmse_before_n,
        "after_n": d.held_out.rmse_after_n,
        "floor_n": d.noise_floor_n,
        "flags": list(d.flags),
        "suspected": list(d.suspected),
    }


def _plain(ff: Any, found: Any) -> Any:  # noqa: ANN401
    """The simulation without causes, fitted to the same recording."""
    fitted = found.details.diagnosis.baseline.parameters
    names = ("mass_kg", "damping_n_s_m", "stiffness_n_m")
    entry = {"effect": "mass_damper_spring", "parameters": {n: fitted.get(n, 0.0) for n in names}}
    made = {"schema": _SCHEMA, "name": "plain", "effects": [entry]}
    return ff.Model(type(found.model.contact).from_mapping(made))


def _carried(ff: Any, found: Any, first: Any, folder: Path) -> dict[str, Any]:  # noqa: ANN401
    """Gain of the extended model over the simulation on the other motion, the bias of each set anew there."""
    second, clean = _loaded(ff, folder / "b.csv"), np.load(folder / "clean.npz")["b"]
    models = {"before": _plain(ff, found), "after": found.model}
    along = {name: [_along(m, run) for run in (first, second)] for name, m in models.items()}
    # one model may count forces as the recording does, another those that resist as positive
    senses = {
        name: float(np.sign(np.dot(runs[0] - np.mean(runs[0]), first.force_n))) or 1.0
        for name, runs in along.items()
    }

    def gain(force: Any, run: int) -> tuple[float, float]:  # noqa: ANN401
        left = {
            name: float(np.std(senses[name] * np.asarray(force) - forces[run]))
            for name, forces in along.items()
        }
        return 1.0 - left["after"] / left["before"], left["after"]

    there, true = gain(second.force_n, 1), gain(clean, 1)
    gains = {"gain_a": gain(first.force_n, 0)[0], "gain_b": there[0], "gain_b_clean": true[0]}
    return {**gains, "left_b_n": there[1]}


def _along(model: Any, run: Any) -> Any:  # noqa: ANN401
    """Force of a model along a run. `simulate` takes 10,000 steps a second: a long one takes fewer here."""
    if run.duration_s <= _SIMULATED_S:
        return model.simulate(run).force_n
    window = np.hanning(9)[1:-1] / np.sum(np.hanning(9))
    smooth = np.convolve(np.pad(run.position_m, 3, "edge"), window, "valid")
    each = max(1, _STEPS // len(smooth))
    t = np.interp(np.arange(len(smooth) * each) / each, np.arange(len(smooth)), run.time_s - run.time_s[0])
    dt = np.maximum(np.diff(t, prepend=-t[1]), 1e-6)
    v = np.interp(t, run.time_s - run.time_s[0], np.gradient(smooth, run.time_s))
    x, a = np.interp(t, run.time_s - run.time_s[0], smooth), np.gradient(v) / dt
    step = model.contact.runtime().step
    course = zip(*(column.tolist() for column in (t, x, v, a, dt)), strict=True)
    return np.array([step(*at) for at in course])[::each]
