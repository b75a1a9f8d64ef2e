"""The library of kernels is of the sources beside it, and Python's records are those of C."""

from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from forefeel.common.causes.motion import Bristle, Gap, Lag, Memory, Oscillator, PrandtlElement, SettledLag
from forefeel.common.errors import InputError
from forefeel.common.kernels import header, library
from forefeel.common.kernels.record import Array, Record


def test_the_header_is_of_the_protocols() -> None:
    assert header.PATH.read_text(encoding="ascii") == header.header()


def test_a_record_of_another_size_than_cs_is_not_made() -> None:
    class Forces(Protocol):
        known: float

    with pytest.raises(TypeError, match=r"^Forces: 8 bytes in Python, 88 in C: write state.h anew"):
        Record(Forces)


class TestLoading:
    def test_no_library_or_none_of_this_machine(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(library, "LIBRARY", tmp_path / "libkernels.so")
        with pytest.raises(InputError, match="not built: make demo"):
            library.kernels.__wrapped__()
        (tmp_path / "libkernels.so").write_bytes(b"of another one")
        with pytest.raises(InputError, match=r"can not be loaded: .*: make demo"):
            library.kernels.__wrapped__()

    def test_a_source_that_has_changed_since(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "kernels.c").write_text("")
        monkeypatch.setattr(library, "FOLDER", tmp_path)
        with pytest.raises(InputError, match="the kernels are older than their source: make demo"):
            library.kernels.__wrapped__()

    def test_without_sources_it_is_loaded(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(library, "FOLDER", tmp_path)
        assert library.kernels.__wrapped__().kernels_sources_sha256()


class TestLoops:
    """Each loop in C gives what its `step` gives in Python, to the bit."""

    RNG = np.random.default_rng(0)
    A, DECAY, SIZE = RNG.standard_normal(3000), RNG.uniform(0.9, 1.0, 3000), RNG.uniform(0.1, 1.0, 3000)
    SPARSE = np.where(RNG.random(3000) > 0.3, A, 0.0)
    RESTING = np.where(RNG.random(3000) > 0.3, A, np.nan)
    RUNS = (
        (PrandtlElement, 0.3 * A),
        (Bristle, SPARSE, DECAY),
        (Lag, A, DECAY),
        (SettledLag, A, DECAY),
        (Gap, A, SIZE, RESTING, DECAY),
        (Gap, A, SIZE, np.full_like(A, np.nan), DECAY),
        (Oscillator, A, 0.9 * DECAY, 0.01 * A, SIZE, 1.0 + SIZE),
    )

    @pytest.mark.parametrize(("kind", "inputs"), [(kind, inputs) for kind, *inputs in RUNS])
    @pytest.mark.parametrize("rows", [slice(None), slice(None, None, 3), slice(0)], ids=str)
    def test_a_loop_is_its_steps(self, kind: type[Memory], inputs: list[Array], rows: slice) -> None:
        some = [values[rows] for values in inputs]
        steps = Memory.run(kind(), *some)
        run = kind().run(*some)
        np.testing.assert_array_equal(run.ravel(), steps.ravel())
        assert run.shape == steps.shape or not steps.size

    def test_arrays_of_two_lengths_are_refused(self) -> None:
        with pytest.raises(ValueError, match="bristle: arrays of shapes"):
            Bristle.run(self.A, self.DECAY[1:])
