"""What stands in for a call that fails."""

from collections.abc import Callable


def refusing(error: Exception) -> Callable[..., None]:
    """Raises `error` whatever it is called with."""

    def refuse(*_: object, **__: object) -> None:
        raise error

    return refuse
