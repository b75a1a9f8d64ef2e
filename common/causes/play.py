"""Play with the moving mass on the stage's side of it."""

from forefeel.common.causes.backlash import Backlash, behind, widths
from forefeel.common.causes.candidate import Transmission


class Play(Backlash):
    """As `backlash`, but the mass moves with the stage: only what resists is behind the gap.

    In a model.yaml the mass is a `mass_damper_spring` of its own at the site `sensor`, which sees the stage.
    """

    name = "play"
    fingerprint = (
        "after each reversal the force of the contact stands still over a constant width of the position, "
        "while the mass is felt at once"
    )
    words = "play between the moving mass and the contact"
    equation = ("x but for the mass behind a play of {width_m} m",)
    candidates = (
        Transmission(
            shapes=("width_m",), sizes=("width_m",), moved=behind, grid=widths, mass_site="sensor",
            picture="reversal",
        ),
    )  # fmt: skip
