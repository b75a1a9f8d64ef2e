"""Attacks where the transport does not matter; those on real processes are in tests.system."""

import pytest

from tests.simulation.attacks import VIRTUAL


@pytest.mark.parametrize("name", VIRTUAL)
def test_attack_is_refused_and_counted(name: str) -> None:
    assert VIRTUAL[name](name).wrong == []
