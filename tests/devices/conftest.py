"""Emulated devices keep their time, as real ones do, although other tests want the processor."""

import pytest


@pytest.fixture(autouse=True)
def emulated(ahead_of_other_work: None) -> None:
    """In all tests of this folder."""
