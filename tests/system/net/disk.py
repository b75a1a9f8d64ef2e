"""A disk that is soon full: a tmpfs in a mount namespace of our own, which this machine does not see."""

import shutil
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Self


class SmallDisk:
    """Mounted on `folder` for those who are started `within`; gone at the end of the `with`.

    Network namespaces that were made before are known there, later ones are not.
    """

    def __init__(self, folder: Path, size_bytes: int) -> None:
        folder.mkdir()
        self.folder = folder
        mount = f"mount -t tmpfs -o size={size_bytes} tmpfs '{folder}' && echo mounted && exec sleep infinity"
        command = ["unshare", "--mount", "--propagation", "private", "sh", "-c", mount]
        self._holder = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "mounted\n":
            self.__exit__()
            raise AssertionError(f"{folder}: no tmpfs could be mounted in a mount namespace")

    @property
    def within(self) -> tuple[str, ...]:
        """What to start a process with that is to see it; it runs in the folder that holds it."""
        where = f"--chdir={self.folder.parent}"  # entering a mount namespace leaves the working directory
        return "nsenter", "--target", str(self._holder.pid), "--mount", "env", where

    @property
    def seen(self) -> Path:
        return Path(f"/proc/{self._holder.pid}/root{self.folder}")

    def fill(self) -> None:
        with (self.seen / "ballast").open("wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(4096))

    def free(self) -> None:
        (self.seen / "ballast").unlink()

    def allow_writing(self, allowed: bool) -> None:
        """It can not be forbidden while a file is open for it."""
        how = "rw" if allowed else "ro"
        subprocess.run([*self.within, "mount", "-o", f"remount,{how}", str(self.folder)], check=True)

    def free_bytes(self) -> int:
        return shutil.disk_usage(self.seen).free

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._holder.kill()
        self._holder.communicate()
