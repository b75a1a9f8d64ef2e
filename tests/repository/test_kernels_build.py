"""The build of the kernels: its choice of a compiler, and its one line where there is none or it fails."""

import subprocess
import sys
from pathlib import Path

import pytest

from forefeel.common.kernels import build

FAILS = f"{sys.executable} -c 'raise SystemExit(1)'"


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> pytest.MonkeyPatch:
    """A machine without a compiler; `tmp_path` is all of its PATH."""
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(build, "find_spec", lambda name: None)
    return monkeypatch


def test_the_compiler_is_cc_of_the_environment_then_that_of_the_machine_then_zig(
    bare: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bare.setattr(build, "find_spec", lambda name: object() if name == "ziglang" else None)
    bare.setattr("platform.machine", lambda: "aarch64")
    assert build.compiler() == [
        sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-gnu.2.17",
    ]  # fmt: skip
    (tmp_path / "cc").touch(mode=0o755)
    assert build.compiler() == ["cc"]
    bare.setenv("CC", "clang --target=x86_64")
    assert build.compiler() == ["clang", "--target=x86_64"]


@pytest.mark.usefixtures("bare")
def test_without_a_compiler_the_error_says_what_to_install() -> None:
    with pytest.raises(build.BuildError, match="apt-get install gcc, or pip install ziglang"):
        build.compiler()


@pytest.mark.parametrize("command", ["no-such-compiler", FAILS])
def test_a_build_that_fails_leaves_the_library_that_there_was(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", command)
    target = tmp_path / "libkernels.so"
    target.write_bytes(b"before")
    with pytest.raises(build.BuildError, match="apt-get install"):
        build.build(target)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"before"]


def test_the_command_says_in_one_line_why_it_did_not_build(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    done = subprocess.run(
        [sys.executable, str(build.FOLDER / "build.py")], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "kernels: no-such-compiler: No such file or directory: apt-get install gcc\n"


def test_the_hash_changes_with_a_name_a_byte_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "a.c").write_text("int a;")
    first = build.sources_sha256(tmp_path)
    (tmp_path / "notes.txt").write_text("-")
    assert build.sources_sha256(tmp_path) == first
    (tmp_path / "a.c").rename(tmp_path / "b.c")
    second = build.sources_sha256(tmp_path)
    (tmp_path / "b.c").write_text("int b;")
    assert len({first, second, build.sources_sha256(tmp_path)}) == 3
