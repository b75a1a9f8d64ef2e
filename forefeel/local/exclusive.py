"""What moves a stage beside the slave may do so only where no slave runs, and nothing is latched."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from forefeel.common.errors import RunError
from forefeel.common.state.folder import LATCHED, StateFolder, state_path
from forefeel.common.state.latch import latched
from forefeel.daemon_settings import load_daemon


@contextmanager
def no_slave_beside(config: Path) -> Iterator[None]:
    """Holds the slave's state folder while the body moves its devices.

    Raises:
        ConfigurationError: the slave of this file runs.
        RunError: an emergency stop is latched.
    """
    folder = state_path(load_daemon(config), "slave", os.environ)
    if not folder.is_dir():  # no slave has ever used it
        yield
        return
    with StateFolder(folder):
        for axis, reason in latched(folder / LATCHED).items():
            raise RunError(
                f"an emergency stop is latched ({axis or 'every axis'}: {reason}); expected it to be cleared "
                "first: start the slave, then `forefeel clear`"
            )
        yield
