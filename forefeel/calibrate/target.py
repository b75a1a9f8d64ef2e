"""The file of a calibration: refused before anything is measured, written whole or not at all."""

import os
from pathlib import Path

from pydantic import BaseModel

from forefeel.common.config import dump_yaml
from forefeel.common.errors import ConfigurationError
from forefeel.files import check_new_file, write_whole

_SUFFIXES = (".yaml", ".yml")


def check_target(out: Path, overwrite: bool) -> None:
    """Raises ConfigurationError: no YAML name, a folder, no room for it, or a file that may not go."""
    check_new_file(out, _SUFFIXES, ".yaml", overwrite)
    if not out.parent.is_dir() or not os.access(out.parent, os.W_OK):
        raise ConfigurationError(f"--out {out}: expected a folder that exists and can be written")


def write_calibration(out: Path, calibration: BaseModel) -> None:
    """Raises RunError: it can not be written."""
    write_whole(out, dump_yaml(calibration), "the calibration")
