"""Compiled code that was kept is used again, and not when any source that it came from has changed."""

import importlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from forefeel.common.estimation import jit

OUTER = """
from kernels_of_a_test.inner import add
from kernels_of_a_test.jit import kernel
@kernel
def outer(x):
    return add(x)
"""
INNER = """
from kernels_of_a_test.jit import kernel
CONSTANT = {}
@kernel
def add(x):
    return x + CONSTANT
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "kernels_of_a_test"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "outer.py").write_text(OUTER)
    (folder / "inner.py").write_text(INNER.format("1.0"))
    shutil.copy(jit.__file__, folder / "jit.py")
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    _forget()


def _forget() -> None:
    for name in [name for name in sys.modules if name.startswith("kernels_of_a_test")]:
        del sys.modules[name]
    importlib.invalidate_caches()


def _result() -> tuple[float, int]:
    """(what the outer kernel returns for 1, how often it was loaded from what had been kept)."""
    _forget()
    outer = importlib.import_module("kernels_of_a_test.outer").outer
    value = outer(1.0)
    return value, sum(outer.stats.cache_hits.values())


def test_a_kernel_is_compiled_once(package: Path) -> None:
    assert _result() == (2.0, 0)
    assert _result() == (2.0, 1)


def test_a_kernel_is_compiled_anew_when_one_that_it_calls_has_changed(package: Path) -> None:
    assert _result() == (2.0, 0)
    (package / "inner.py").write_text(INNER.format("10.0"))
    assert _result() == (11.0, 0)
