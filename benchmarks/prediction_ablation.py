"""What each part of the predictor is worth: the product as it is, but for one thing that is taken out while
it runs.

A member of the blend is left without a weight. A cause of the contact model gets a prior standard deviation
of next to nothing, so that no fit gives it a share of the force.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from unittest import mock

from forefeel.common.causes.base import Parameter
from forefeel.common.estimation import blend, contact_model
from forefeel.common.estimation.evaluator import Snapshot
from forefeel.common.estimation.learner import Learner

_NOTHING = 1e-4  # of the force's spread

_CAUSES: Mapping[str, tuple[str, ...]] = {
    "mass": ("mass_damper_spring.mass_kg",),
    "presliding friction": ("presliding_hysteresis.",),
    "position-dependent friction": ("position_dependent_friction.",),
    "relaxation": ("stress_relaxation.",),
    "stiffening, Hunt-Crossley damping": ("stiffening.", "hunt_crossley_damping."),
    "heart": tuple(f"{name}." for name in ("pulsation", "pulsation-2", "pulsation-3", "pulsation-4")),
    "breath": ("pulsation-5.", "pulsation-6."),
}


def _without_members(*names: str) -> AbstractContextManager[object]:
    publish, silent = Learner.publish, [blend.NAMES.index(name) for name in names]

    def published(learner: Learner) -> Snapshot:
        snapshot = publish(learner)
        snapshot.learned.values["weights"][silent] = 0.0
        return snapshot

    return mock.patch.object(Learner, "publish", published)


def _without_terms(*begins: str) -> AbstractContextManager[object]:
    parameter = contact_model._parameter

    def remaining(name: str) -> Parameter:
        known = parameter(name)
        return replace(known, explains=_NOTHING) if name.startswith(begins) else known

    return mock.patch.object(contact_model, "_parameter", remaining)


def _variants() -> dict[str, Callable[[], AbstractContextManager[object]]]:
    contacts = blend.NAMES[blend.CONTACT :]
    members = {name: (name,) for name in blend.NAMES} | {" and ".join(contacts): contacts}
    everything = tuple(begin for begins in _CAUSES.values() for begin in begins)
    return {
        "forefeel": nullcontext,
        **{f"without {name}": partial(_without_members, *each) for name, each in members.items()},
        **{f"contact without {name}": partial(_without_terms, *each) for name, each in _CAUSES.items()},
        "contact with spring and damper only": partial(_without_terms, *everything),
    }


VARIANTS = _variants()
"""By name: a context in which the predictor lacks that part; first the whole."""
