"""Whether the driver keeps its port: run by pytest where this package is installed."""

from forefeel.testing import LoadCellContract


class TestIio(LoadCellContract):
    driver = "iio"
