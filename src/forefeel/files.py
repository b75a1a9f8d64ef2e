"""Output of a command: a folder for its results, and files that are there whole or not at all."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.interrupt import at_last, signal_flag


def fresh_folder(folder: Path, ours: Sequence[str], what: str, overwrite: bool) -> None:
    """Makes the folder where it is missing and tests that it can be written; earlier results stay until the
    command replaces them.

    Args:
        folder: what `--out` says.
        ours: names of the files that the command writes; no other is looked at.
        what: the earlier results in words, such as `an earlier run`.
        overwrite: whether they may be replaced.

    Raises:
        ConfigurationError: a file, not writable, or with earlier results that may not be replaced.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"--out {folder}: is a file; expected a folder")
    if not overwrite and any((folder / name).exists() for name in ours):
        raise ConfigurationError(f"--out {folder}: holds {what}; expected another folder, or --overwrite")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ConfigurationError(
            f"--out {folder}: {error.strerror}; expected a folder that can be written"
        ) from error


def folder_named_after(source: Path) -> Path:
    """The folder in the working directory that takes the results of a recording, or of a folder of them."""
    return Path(source.resolve().name if source.is_dir() else source.stem)


def check_new_file(out: Path, suffixes: Sequence[str], expected: str, overwrite: bool) -> None:
    """Refuses a path of `--out`; touches nothing. `suffixes`: in lower case; `expected`: the same in words.

    Raises:
        ConfigurationError: another suffix, a folder, or a file that exists without `overwrite`.
    """
    if out.suffix.lower() not in suffixes:
        raise ConfigurationError(f"--out {out}: suffix {out.suffix!r}, expected {expected}")
    if out.is_dir():
        raise ConfigurationError(f"--out {out}: is a folder, expected a file")
    if out.exists() and not overwrite:
        raise ConfigurationError(f"--out {out}: exists, expected a new file, or --overwrite")


def write_all(folder: Path, texts: Mapping[str, str], written: list[str]) -> None:
    """Writes each text to its file, in order, and adds its name to `written`; a signal waits until all are.

    Raises:
        RunError: one can not be written.
    """
    with signal_flag():
        for name, text in texts.items():
            write_whole(folder / name, text)
            written.append(name)


def write_whole(path: Path, text: str, what: str = "the report") -> None:
    with whole(path, what) as part:
        part.write_text(text, encoding="utf-8", errors="replace")  # a file name may be no UTF-8


@contextmanager
def whole(path: Path, what: str) -> Iterator[Path]:
    """Gives a temporary path beside `path` to write to, and replaces `path` by that file in one step after a
    body that raises nothing; else the temporary file is removed. Makes the folder. `what`: for the error.

    Raises:
        RunError: an OSError, of the body, too.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with at_last(partial(part.unlink, missing_ok=True)):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield part
            part.replace(path)
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}, {what} is not written") from error
