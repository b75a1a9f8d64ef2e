"""What is said where a command needs packages that are not installed with the rest."""

from collections.abc import Iterator
from contextlib import contextmanager

from forefeel.common.errors import ConfigurationError


@contextmanager
def extra(name: str, *packages: str, command: str) -> Iterator[None]:
    """Imports inside need the packages of the extra `forefeel[name]`; any other that is missing is our fault.

    Raises:
        ConfigurationError: one of `packages` is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in packages:
            raise
        raise ConfigurationError(f"{command}: {how_to_get(name)}") from error


def how_to_get(name: str) -> str:
    """What to do about it."""
    return f"needs an extra: pip install forefeel[{name}]"
