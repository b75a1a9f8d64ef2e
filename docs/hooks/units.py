"""The unit of a quantity by the end of its name, as CONTRIBUTING.md has it. Pure."""

# the longest ending first: `_m_s2` also ends in `_s2`
_ENDINGS = {
    "_n_s2_m2": "N s²/m²",
    "_n_s_m2": "N s/m²",
    "_n_s_m": "N s/m",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_n_s": "N/s",
    "_n_m": "N/m",
    "newton_per_ampere": "N/A",
    "native_per_m": "native units/m",
    "counts_per_m": "counts/m",
    "stalls_per_s": "1/s",
    "_hz": "Hz",
    "_kg": "kg",
    "_ns": "ns",
    "_us": "µs",
    "_days": "days",
    "_deg": "°",
    "_s": "s",
    "_mm": "mm",
    "_m": "m",
    "_n": "N",
    "_a": "A",
    "_j": "J",
    "_c": "°C",
}
_WHOLE = {
    "bitrate": "bit/s",
    "baud": "bit/s",
    "bits": "bits",
    "gain_n": "N per native unit",
    "zero": "native units",
    "euler_n_m2": "N m²",
    "stiffness_n_m2": "N m²",
    "full_scale_native": "native units",
}


def unit_of(name: str) -> str:
    """The unit of the setting or field with that name, as it is printed; empty where it has none."""
    if name in _WHOLE:
        return _WHOLE[name]
    return next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "")
