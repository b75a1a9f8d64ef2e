"""The person who changes the weights and clears the way: a line on stderr, Enter on stdin."""

import sys

from forefeel.common.errors import RunError
from forefeel.terminal import ask, say


class Prompt:
    """`yes`: nobody is asked; what would be asked is said all the same."""

    def __init__(self, yes: bool) -> None:
        self._yes = yes

    def wait(self, text: str) -> None:
        """Says what to do and waits for Enter, from a terminal or a pipe.

        Raises:
            RunError: stdin ended.
        """
        if self._yes:
            say(text)
        else:
            ask(f"{text}, then press Enter")
            self._line(text)

    def agree(self, text: str) -> None:
        """Says what would happen and waits for `yes`.

        Raises:
            RunError: any other answer, or none.
        """
        if self._yes:
            say(text)
            return
        ask(f"{text}. Type yes to go on")
        if self._line(text).strip().lower() not in ("yes", "y"):
            raise RunError("not confirmed; nothing moved, nothing written")

    @staticmethod
    def _line(text: str) -> str:
        line = sys.stdin.readline()
        if not line:
            raise RunError(f"stdin ended at '{text}': expected a line, or --yes; nothing was written")
        return line
