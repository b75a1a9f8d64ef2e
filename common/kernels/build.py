"""Builds libkernels.so of the C files beside this one: `python common/kernels/build.py`.

With --check it builds nothing; exit code 1: the library is not there or is of other sources.

The compiler is $CC, else cc, else the one of the Python package ziglang. Neither Python.h nor anything beyond
the standard library is needed: make and setup.py load this file by its path before the package is installed.
"""

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

FOLDER = Path(__file__).parent
LIBRARY = FOLDER / "libkernels.so"
# Results are the same bits by any compiler and at any -O: no fused multiply-add, no reordered sums.
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")


class BuildError(Exception):
    """One line: what is missing, and what to install."""


def sources_sha256(folder: Path) -> str:
    """Hash of the names and contents of all C files and headers, which the library carries."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.[ch]")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def is_current(library: Path) -> bool:
    """True if the library carries the hash of the present sources."""
    # read and not loaded, which fails for one of another processor or with sanitizers
    return library.exists() and sources_sha256(FOLDER).encode() in library.read_bytes()


def compiler() -> list[str]:
    """Command of the C compiler: $CC, else cc, else that of the package ziglang.

    Raises:
        BuildError: there is none.
    """
    if command := os.getenv("CC"):
        return shlex.split(command)
    if shutil.which("cc"):
        return ["cc"]
    if find_spec("ziglang"):  # its library runs with every glibc since 2.17
        target = f"{platform.machine()}-linux-gnu.2.17"
        return [sys.executable, "-m", "ziglang", "cc", "-target", target]
    raise BuildError("there is no C compiler: apt-get install gcc, or pip install ziglang")


def build(target: Path) -> str:
    """Compiles kernels.c to the library `target`, which it replaces only by a whole one, and returns the
    compiler's command without flags. CFLAGS of the environment come last.

    Raises:
        BuildError: no compiler, or it failed and has written why to stderr.
    """
    command = compiler()
    with TemporaryDirectory(dir=target.parent) as folder:
        library = Path(folder) / target.name
        sha256 = f'-DSOURCES_SHA256="{sources_sha256(FOLDER)}"'
        flags = [*FLAGS, sha256, *shlex.split(os.getenv("CFLAGS", ""))]
        files = ["-o", str(library), str(FOLDER / "kernels.c"), "-lm"]
        caches = {"ZIG_GLOBAL_CACHE_DIR": folder, "ZIG_LOCAL_CACHE_DIR": folder}
        try:
            subprocess.run([*command, *flags, *files], env=caches | os.environ, check=True)
        except OSError as error:
            raise BuildError(f"{command[0]}: {error.strerror}: apt-get install gcc") from None
        except subprocess.CalledProcessError:
            raise BuildError(f"{command[0]} failed (no string.h: apt-get install libc6-dev)") from None
        library.replace(target)  # a process that runs keeps the library that it has loaded
    return shlex.join(command)


if __name__ == "__main__":
    if "--check" in sys.argv:
        sys.exit(0 if is_current(LIBRARY) else 1)
    try:
        print(f"kernels: built by {build(LIBRARY)}")
    except BuildError as error:
        print(f"kernels: {error}", file=sys.stderr)
        sys.exit(2)
