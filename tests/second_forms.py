"""Second forms of a long test run in the soak."""

from collections.abc import Container, Iterable

import pytest
from _pytest.mark.structures import ParameterSet


def forms(values: Iterable[object], *, quick: Container[object]) -> list[ParameterSet]:
    """The values as parameters: `quick` in every run, the others in the soak alone."""
    return [pytest.param(each, marks=() if each in quick else pytest.mark.soak) for each in values]
