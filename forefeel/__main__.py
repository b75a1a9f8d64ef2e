"""Entry point: exit 0 done, 1 the run failed, 2 the input was wrong; every failure is one line."""

import sys

from common.errors import ForefeelError, InputError


def main() -> None:
    """Runs the command line."""
    from forefeel.cli import app  # noqa: PLC0415 - so that an import error of an extra is one line, too

    try:
        app()
    except InputError as error:
        _complain(error, 2)
    except ForefeelError as error:
        _complain(error, 1)


def _complain(error: ForefeelError, code: int) -> None:
    print(f"forefeel: {error}", file=sys.stderr, flush=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
