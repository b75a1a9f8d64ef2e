"""Runs in virtual time."""

import gc
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def no_collection() -> Iterator[None]:
    """What is made stays, as recorded payloads: collecting would find nothing, slowly."""
    gc.disable()
    yield
    gc.enable()
    gc.collect()
