"""Values of the simulated worlds: a catheter (to about 1 N over 100 mm) and a guidewire (5 to 100 mN).

The contact begins 8 mm beyond the start. The haemostasis valve rubs along the shaft; the vessel wall is
viscoelastic, relaxes, rubs more with each inserted millimetre, and moves with heart and breath.
"""

from typing import Any

from forefeel.common.causes.model import SCHEMA

_STAGE = {
    "travel_lower_m": -0.005,
    "travel_upper_m": 0.125,
    "start_m": 0.0,
    "bandwidth_hz": 25.0,
    "velocity_limit_m_s": 0.25,
    "acceleration_limit_m_s2": 20.0,
    "encoder_step_m": 1e-6,
    "device_watchdog_s": 0.1,
}


def _contact(name: str, **parameters: dict[str, float]) -> dict[str, Any]:
    """Mapping of a contact model: an effect for each argument, in that order, then heart and breath."""
    pulsations = [parameters.pop("heart"), parameters.pop("breath")]
    effects = [{"effect": effect, "parameters": values} for effect, values in parameters.items()]
    effects += [{"effect": "pulsation", "parameters": values} for values in pulsations]
    return {"schema": SCHEMA, "name": name, "effects": effects}


PRESETS: dict[str, dict[str, Any]] = {
    "catheter": {
        "stage": _STAGE,
        "fixture": {"inserted_m": 0.0},
        "contact": _contact(
            "catheter",
            contact_loss={"contact_position_m": 0.008},
            presliding_hysteresis={"force_n": 0.08, "stiffness_n_m": 250.0},
            mass_damper_spring={"mass_kg": 0.01, "damping_n_s_m": 0.4, "stiffness_n_m": 7.5},
            position_dependent_friction={"force_per_length_n_m": 1.0},
            stress_relaxation={"stiffness_n_m": 3.0, "time_constant_s": 0.6},
            heart={"amplitude_n": 0.012, "frequency_hz": 1.17, "second_harmonic_ratio": 0.3},
            breath={"amplitude_n": 0.015, "frequency_hz": 0.23},
        ),
        "load_cell": {
            "full_scale_n": 5.0,
            "bits": 16,
            "filter_hz": 200.0,
            "noise_n": 0.002,
            "bias_n": 0.01,
            "drift_n_s": 1e-5,
        },
    },
    "guidewire": {
        "stage": _STAGE,
        "fixture": {"inserted_m": 0.0},
        "contact": _contact(
            "guidewire",
            contact_loss={"contact_position_m": 0.008},
            presliding_hysteresis={"force_n": 0.008, "stiffness_n_m": 25.0},
            mass_damper_spring={"mass_kg": 0.001, "damping_n_s_m": 0.03, "stiffness_n_m": 0.55},
            position_dependent_friction={"force_per_length_n_m": 0.1},
            stress_relaxation={"stiffness_n_m": 0.25, "time_constant_s": 0.8},
            heart={"amplitude_n": 0.0012, "frequency_hz": 1.17, "second_harmonic_ratio": 0.3},
            breath={"amplitude_n": 0.0015, "frequency_hz": 0.23},
        ),
        "load_cell": {
            "full_scale_n": 0.5,
            "bits": 16,
            "filter_hz": 200.0,
            "noise_n": 0.0004,
            "bias_n": 0.001,
            "drift_n_s": 2e-6,
        },
    },
}
