"""A model parted at the load cell's converter: what acts in continuous time, and what acts on readings."""

from forefeel.common.causes.base import SensorEffect
from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.registry import effect_class


def at_conversion(model: ContactModel) -> tuple[ContactModel, list[SensorEffect]]:
    """What acts in continuous time, and the sensor effects that act at each conversion, in their order.

    A linear sensor effect, such as a lag, acts in continuous time; one that rounds, clips or disturbs single
    readings does so when the load cell converts, and sees its noise.
    """
    continuous, converts = [], []
    for entry in model.effects:
        kind = effect_class(entry.effect)
        if issubclass(kind, SensorEffect) and not kind.linear:
            converts.append(kind(**dict(entry.parameters)))
        else:
            continuous.append(entry)
    return ContactModel(model.name, tuple(continuous)), converts
