"""The diagnosis and its peers, by name. A peer is imported where it is asked for: each is an extra."""

from importlib import import_module

from tests.hidden_effects.answers import Method

PRODUCT = "product"
TITLES = {
    PRODUCT: "diagnosis",
    "pysindy": "PySINDy STLSQ",
    "sysidentpy": "sysidentpy FROLS",
    "memory": "STLSQ over the diagnosis' columns",
}
_FUNCTIONS = {
    PRODUCT: ("product", "diagnosed"),
    "pysindy": ("sindy", "sparse"),
    "sysidentpy": ("frols", "regressed"),
    "memory": ("memory", "sparse_with_memory"),
}


def method_of(name: str) -> Method:
    """One of TITLES.

    Raises:
        ImportError: its library is not installed.
    """
    module, function = _FUNCTIONS[name]
    found: Method = getattr(import_module(f"tests.hidden_effects.{module}"), function)
    return found
