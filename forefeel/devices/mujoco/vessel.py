"""The vessel of a YAML file with its guidewire: a world that steps twice in a millisecond."""

from math import radians

from forefeel.common.errors import ConfigurationError
from forefeel.devices.mujoco.path import GUIDE_M, WALL_M, Path, Piece
from forefeel.devices.mujoco.settings import GuidewireSettings, PieceSettings
from forefeel.devices.mujoco.wire import Guidewire, WireChain


def make_vessel(settings: GuidewireSettings) -> Guidewire:
    """The wire at rest in its vessel, with the stage at the beginning of the guide.

    Raises:
        ConfigurationError: the vessel crosses itself, has a bend that its wall has no room in, or is shorter
            than what the wire reaches.
    """
    half_m = 0.5 * settings.lumen_m
    tightest_m, least_m = min(piece.radius_m or 1.0 for piece in settings.pieces), half_m + 2.0 * WALL_M
    if tightest_m < least_m:
        raise ConfigurationError(f"vessel: radius_m = {tightest_m:g}; expected at least {least_m:g}")
    pieces = (
        Piece(settings.guide_m, 0.0, 0.5 * GUIDE_M),
        *(_piece(piece, half_m) for piece in settings.pieces),
    )
    path, length_m = Path(pieces), settings.guide_m + settings.inserted_m
    reaches_m = length_m + settings.guide_m  # the stage at the end of its travel
    if path.length_m < reaches_m:
        within = f"{reaches_m:g} m: what the wire reaches at the end of the guide"
        raise ConfigurationError(f"vessel: {path.length_m:.3g} m long with its guide; expected {within}")
    if path.crosses_itself():
        raise ConfigurationError("vessel: it crosses itself; expected pieces that keep apart")
    of = settings.wire
    wire = WireChain(of.stiffness_n_m2, of.radius_m, length_m, of.segment_m, of.soft_tip)
    world = Guidewire(wire, path, settings.friction)
    world.settle()
    return world


def _piece(settings: PieceSettings, half_m: float) -> Piece:
    if settings.radius_m is None:
        assert settings.length_m is not None
        return Piece(settings.length_m, 0.0, half_m)
    turn = radians(settings.turn_deg or 0.0)
    return Piece(settings.radius_m * abs(turn), (1.0 if turn > 0.0 else -1.0) / settings.radius_m, half_m)
