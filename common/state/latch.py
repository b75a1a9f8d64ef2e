"""Emergency stops that outlive the daemon: a kill and a new start do not clear them."""

import json
import os
from pathlib import Path

from common.state.folder import sync_folder


class Latch:
    """Which axes are stopped, in a file that is there only while one is.

    Attributes:
        reasons: by axis, as they are now; of a file that can not be read one for all, under the empty name.
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
        self._written: dict[str, str] | None = self.reasons

    def keep(self, axis: str, reason: str | None) -> None:
        """That an axis is stopped for a reason, or is not; in `reasons` whatever happens to the file.

        Raises:
            OSError: it can not be written; `write` tries again.
        """
        reasons = {name: text for name, text in self.reasons.items() if name not in (axis, "")}
        if reason is not None:
            reasons[axis] = reason
        self.reasons = reasons
        self.write()

    def write(self) -> None:
        """Makes the file say what `reasons` say, where it does not yet; on the disk when it returns.

        Raises:
            OSError: it can not be written.
        """
        reasons = self.reasons
        if reasons == self._written:
            return
        self._written = None  # half-way it may say either
        if reasons:
            self._replace(json.dumps(reasons).encode())
        else:
            self._path.unlink(missing_ok=True)
        sync_folder(self._path.parent)
        self._written = reasons

    def _replace(self, data: bytes) -> None:
        part = self._path.with_name(f".{self._path.name}.part")
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb") as file:  # which writes all of it, or raises
            file.write(data)
            file.flush()
            os.fsync(descriptor)
        part.replace(self._path)
