"""The vessel of a YAML file with its guidewire: a world that steps twice in a millisecond."""

from forefeel.common.errors import ConfigurationError
from forefeel.devices.mujoco.path import WALL_M, vessel_path
from forefeel.devices.mujoco.settings import GuidewireSettings
from forefeel.devices.mujoco.wire import Guidewire, WireChain

_MOST_SEGMENTS = 495  # of MuJoCo 4.0.1, which reads no XML that is nested deeper


def make_vessel(settings: GuidewireSettings) -> Guidewire:
    """The wire at rest in its vessel, with the stage at the beginning of the guide.

    Raises:
        ConfigurationError: the vessel crosses itself, has a bend that its wall has no room in, or is shorter
            than what the wire reaches; or the wire has no segment, or too many.
    """
    half_m = 0.5 * settings.lumen_m
    tightest_m, least_m = min(piece.radius_m or 1.0 for piece in settings.pieces), half_m + 2.0 * WALL_M
    if tightest_m < least_m:
        raise ConfigurationError(f"vessel: radius_m = {tightest_m:g}; expected at least {least_m:g}")
    path, length_m = vessel_path(settings), settings.guide_m + settings.inserted_m
    reaches_m = length_m + settings.guide_m  # the stage at the end of its travel
    if path.length_m < reaches_m:
        within = f"{reaches_m:g} m: what the wire reaches at the end of the guide"
        raise ConfigurationError(f"vessel: {path.length_m:.3g} m long with its guide; expected {within}")
    if path.crosses_itself():
        raise ConfigurationError("vessel: it crosses itself; expected pieces that keep apart")
    of = settings.wire
    wire = WireChain(of.stiffness_n_m2, of.radius_m, length_m, of.segment_m, of.soft_tip)
    if not 1 <= wire.segments <= _MOST_SEGMENTS:
        made = f"{wire.segments} segments on {length_m:g} m; expected 1 to {_MOST_SEGMENTS}"
        raise ConfigurationError(f"vessel: segment_m = {of.segment_m:g}: {made}")
    world = Guidewire(wire, path, settings.friction)
    world.settle()
    return world
