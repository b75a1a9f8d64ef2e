"""The library of kernels is of the sources beside it, and Python's records are those of C."""

import ctypes
from pathlib import Path
from typing import Protocol

import pytest

from forefeel.common.errors import InputError
from forefeel.common.kernels import header, library
from forefeel.common.kernels.record import Numbers, Record


def test_the_header_is_of_the_protocols() -> None:
    assert header.PATH.read_text(encoding="ascii") == header.header()


def test_a_record_of_another_size_than_cs_is_not_made() -> None:
    class Forces(Protocol):
        known: float

    with pytest.raises(TypeError, match=r"^Forces: 8 bytes in Python, 88 in C: write state.h anew"):
        Record(Forces)


def test_numbers_are_where_c_looks_for_them() -> None:
    class Reading(Protocol):
        stamp_s: float
        force_n: float

    reading = Numbers(Reading)
    reading.pack(1.5, -2.0)
    assert list((ctypes.c_double * 2).from_address(reading.address)) == [1.5, -2.0]
    assert reading.unpack() == (1.5, -2.0)


class TestLoading:
    def test_no_library(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(library, "LIBRARY", tmp_path / "libkernels.so")
        with pytest.raises(InputError, match="the kernels are not built: make demo"):
            library.kernels.__wrapped__()

    def test_no_library_of_this_machine(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "libkernels.so").write_bytes(b"of another one")
        monkeypatch.setattr(library, "LIBRARY", tmp_path / "libkernels.so")
        with pytest.raises(InputError, match=r"can not be loaded: .*: make demo"):
            library.kernels.__wrapped__()

    def test_a_source_that_has_changed_since(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "kernels.c").write_text("")
        monkeypatch.setattr(library, "FOLDER", tmp_path)
        with pytest.raises(InputError, match="the kernels are older than their source: make demo"):
            library.kernels.__wrapped__()

    def test_a_wheel_brings_no_sources(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(library, "FOLDER", tmp_path)
        assert library.kernels.__wrapped__().kernels_sources_sha256()
