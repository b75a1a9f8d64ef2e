"""One simulated recording from the options to the file."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forefeel.common.causes.model import ContactModel, at_conversion
from forefeel.common.causes.motion import Motion
from forefeel.common.errors import ConfigurationError, InputError, UntimedError
from forefeel.common.model_file import load_model
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.recording import Array
from forefeel.common.recording.units import Mapping
from forefeel.files import check_new_file, whole
from forefeel.interrupt import ends_in_order
from forefeel.simulate.motion import FollowedRecording, Hand, MotionPiece, multisine, sine
from forefeel.simulate.world import integrate
from forefeel.slave.plant.presets import PRESETS
from forefeel.terminal import bar, show

SUFFIXES = (".csv", ".parquet")


def write_table(out: Path, columns: dict[str, Array]) -> None:
    """Writes the columns, by name, as Parquet, or as CSV with a header, by the suffix of `out`; the file is
    there whole or as it was. RunError: it can not be written.
    """
    with whole(out, "the recording") as part:
        if out.suffix.lower() == ".parquet":
            _parquet(part, columns)
        else:
            rows = np.stack(list(columns.values()), axis=1)
            np.savetxt(part, rows, "%.12g", ",", header=",".join(columns), comments="")


def _parquet(path: Path, columns: dict[str, Array]) -> None:
    """Writes the columns as Parquet. InputError: pyarrow is not installed."""
    try:
        import pyarrow  # noqa: PLC0415
        import pyarrow.parquet  # noqa: PLC0415
    except ImportError as error:
        raise InputError(f"{path.suffix}: needs pyarrow: pip install 'forefeel[formats]'") from error
    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)


MOTIONS = ("hand", "multisine", "sine")
_LONGEST_S = 86_400.0  # s, longest recording: a day
# samples of a recording: each column takes 320 MB as float64, all are in memory
_MOST_SAMPLES = 40_000_000


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Options of a simulation. `model`: a file, or one of `PRESETS`. `motion`: one of `MOTIONS`, or the path
    of a recording whose position is followed, by its `columns` of time and position, each as `unit:column`.

    `duration_s` and `rate_hz`: None for those of the recorded motion, else 30 s and 1 kHz; its rows without a
    time have `rate_hz`, too. `noise_n`: white, its standard deviation. `encoder_step_m`: 0: none.
    """

    model: Path
    motion: str = "hand"
    duration_s: float | None = None
    rate_hz: float | None = None
    seed: int = 0
    start_m: float = 0.0
    depth_m: float = 0.03
    frequency_hz: float = 0.5
    noise_n: float = 0.002
    encoder_step_m: float = 1e-6
    columns: tuple[str | None, str | None] = (None, None)


def run_simulation(options: SimulationOptions, out: Path, overwrite: bool) -> None:
    """Simulates a recording, writes it, and prints a summary.

    Raises:
        InputError: the options can not be fulfilled; nothing was written.
        RunError: interrupted, or the file can not be written.
    """
    _check(options)
    check_new_file(out, SUFFIXES, ".csv or .parquet", overwrite)
    made = PRESETS.get(str(options.model))
    model = load_model(options.model) if made is None else ContactModel.from_mapping(made["contact"])
    with ends_in_order("simulation", out.parent) as written:
        with bar(1.0, "{task.percentage:3.0f} %") as shown:
            columns = simulate(model, options, lambda share: shown(share, "simulating"))
        write_table(out, columns)
        written.append(out.name)
    force_n = columns["force_n"]
    show(
        f"{out}: {len(force_n)} samples over {np.ptp(columns['time_s']):g} s of {model.name!r}, "
        f"force {force_n.min():.4g} to {force_n.max():.4g} N, seed {options.seed}"
    )


def simulate(
    model: ContactModel, options: SimulationOptions, shown: Callable[[float], None] = lambda _share: None
) -> dict[str, Array]:
    """Simulates the columns time_s, position_m and force_n, each shape (n,): the model's force along the
    motion with the sensor's noise and conversion, the position in steps of the encoder. `shown` gets the
    share done, 0 to 1.

    Raises:
        InputError: the recorded motion can not be used, or the force is not finite.
    """
    random = np.random.default_rng(options.seed)
    pieces = _pieces(options, random)
    stamps_s = np.concatenate([piece.stamps_s for piece in pieces])
    continuous, converts = at_conversion(model)
    span_s = float(np.ptp(stamps_s))
    position_m, force_n = integrate(continuous, pieces, lambda now_s: shown((now_s - stamps_s[0]) / span_s))
    force_n = force_n + random.normal(0.0, options.noise_n, len(stamps_s))
    motion = Motion.of(stamps_s - stamps_s[0], *np.zeros((3, len(stamps_s))))
    for effect in converts:
        force_n = effect.reading(motion, force_n)
    if step_m := options.encoder_step_m:
        position_m = np.rint(position_m / step_m) * step_m
    return {"time_s": stamps_s, "position_m": position_m, "force_n": force_n}


def _pieces(options: SimulationOptions, random: np.random.Generator) -> list[MotionPiece]:
    """Motions to simulate, each with its stamps in s: one of `MOTIONS`, or the pieces without gaps of the
    recording that `motion` names. Draws a hand or a multisine from `random`.
    """
    if options.motion not in MOTIONS:
        return _followed(Path(options.motion), options)
    duration_s = 30.0 if options.duration_s is None else options.duration_s
    stamps_s = _grid(0.0, duration_s, options.rate_hz or 1000.0)
    if options.motion == "sine":
        return [MotionPiece(sine(options.start_m, options.depth_m, options.frequency_hz), stamps_s)]
    if options.motion == "multisine":
        return [MotionPiece(multisine(options.start_m, options.depth_m, random), stamps_s)]
    return [MotionPiece(Hand(options.start_m, options.depth_m, duration_s, random), stamps_s)]


def _followed(path: Path, options: SimulationOptions) -> list[MotionPiece]:
    """Loads a recording to follow, without its force; returns its pieces without gaps, with its own stamps or
    a grid of `rate_hz`, to `duration_s` after its first stamp, or a day. ConfigurationError: no such file.
    """
    if not path.exists():
        expected = ", ".join(MOTIONS)
        raise ConfigurationError(f"--motion {path}: expected {expected}, or the file of a recording")
    columns = Mapping(*options.columns)
    try:
        recording = load_recording(path, columns, force=False)
    except UntimedError:
        if options.rate_hz is None:
            raise
        recording = load_recording(path, replace(columns, rate_hz=options.rate_hz), force=False)
    end_s = float(recording.time_s[0]) + (_LONGEST_S if options.duration_s is None else options.duration_s)
    pieces = []
    for part in recording.segments():
        times_s = recording.time_s[part]
        if options.rate_hz is not None:
            times_s = _grid(float(times_s[0]), float(times_s[-1]), options.rate_hz)
        stamps_s = times_s[times_s <= end_s]
        if len(stamps_s):
            pieces.append(MotionPiece(FollowedRecording(recording, part), stamps_s))
    return pieces


def _grid(first_s: float, last_s: float, rate_hz: float) -> Array:
    return first_s + np.arange(int((last_s - first_s) * rate_hz * (1.0 + 1e-9)) + 1) / rate_hz


def _check(options: SimulationOptions) -> None:
    """Raises ConfigurationError: names of columns without a recording to follow, or a duration and rate that
    ask for more than `_MOST_SAMPLES`.
    """
    named = next((column for column in options.columns if column is not None), None)
    if options.motion in MOTIONS and named is not None:
        raise ConfigurationError(f"{named}: expected only with the file of a recording as --motion")
    samples = (options.duration_s or 0.0) * (options.rate_hz or 1000.0)
    if samples > _MOST_SAMPLES:
        raise ConfigurationError(
            f"--duration and --rate: {samples:.3g} samples, expected at most {_MOST_SAMPLES:.0g}"
        )
