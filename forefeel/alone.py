"""What `--config` stands for."""

from forefeel.common.errors import ConfigurationError


def check_alone(*others: object) -> None:
    """Refuses options that the file of `--config` settles; `others` are empty, None or False where not given.

    Raises:
        ConfigurationError: one was given.
    """
    if any(others):
        raise ConfigurationError("--config: stands for every option about the network; expected it alone")
