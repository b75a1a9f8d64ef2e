"""Runs in virtual time."""

import gc
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def no_collection() -> Iterator[None]:
    """What is made stays, as recorded payloads: collecting would find nothing, slowly. At the end only what
    the test made is looked through, not what was there before: imports, runs that tests share.
    """
    gc.freeze()
    gc.disable()
    yield
    gc.enable()
    gc.collect()
