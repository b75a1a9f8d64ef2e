"""Emergency stops that outlive the daemon: a kill and a new start do not clear them."""

import json
import os
from pathlib import Path


class Latch:
    """Which axes are stopped, in a file that is there only while one is.

    Attributes:
        reasons: by axis; of a file that can not be read one for all, under the empty name.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.reasons: dict[str, str] = {}
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            self.reasons = {str(axis): str(reason) for axis, reason in found.items()}
        except FileNotFoundError:
            pass
        except (OSError, ValueError, AttributeError):
            self.reasons = {"": "what was latched can not be read"}

    def keep(self, axis: str, reason: str | None) -> None:
        """That an axis is stopped for a reason, or is not.

        Raises:
            OSError: it can not be written.
        """
        reasons = {name: text for name, text in self.reasons.items() if name not in (axis, "")}
        if reason is not None:
            reasons[axis] = reason
        if reasons == self.reasons:
            return
        self.reasons = reasons
        if not reasons:
            self._path.unlink(missing_ok=True)
            return
        part = self._path.with_name(f".{self._path.name}.part")
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            os.write(descriptor, json.dumps(reasons).encode())
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        part.replace(self._path)
