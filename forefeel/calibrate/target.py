"""The file of a calibration: refused before anything is measured, written whole or not at all."""

import os
from pathlib import Path

from pydantic import BaseModel

from common.config import dump_yaml
from common.errors import ConfigurationError
from forefeel.files import write_whole
from forefeel.interrupt import postponed

_SUFFIXES = (".yaml", ".yml")


def check_target(out: Path, overwrite: bool) -> None:
    """Raises ConfigurationError: no YAML name, a folder, no room for it, or a file that may not go."""
    if out.suffix.lower() not in _SUFFIXES:
        raise ConfigurationError(f"--out {out}: suffix {out.suffix!r}, expected .yaml")
    if out.is_dir():
        raise ConfigurationError(f"--out {out}: is a folder, expected a file")
    if out.exists() and not overwrite:
        raise ConfigurationError(f"--out {out}: exists, expected a new file, or --overwrite")
    if not out.parent.is_dir() or not os.access(out.parent, os.W_OK):
        raise ConfigurationError(f"--out {out}: expected a folder that exists and can be written")


def write_calibration(out: Path, calibration: BaseModel) -> None:
    """Raises RunError: it can not be written."""
    with postponed():
        write_whole(out, dump_yaml(calibration), "the calibration")
