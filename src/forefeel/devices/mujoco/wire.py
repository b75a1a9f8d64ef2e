"""A guidewire in a vessel, by MuJoCo: a chain of capsules with hinge springs, held by a cell on a stage.

Settings outside of which the wire leaves its vessel or the numbers are wrong, as measured:
steps above .5 ms with these contacts; walls of boxes (corners let a thin capsule in; bars with a radius do
not); hinges whose inertia is below that of `_HINGE_S`, or a wire without mass (contacts are as stiff as what
they touch is heavy); contacts that are hard at once, for they push the wire off and lose it by turns, at
130 Hz. Pyramidal cones creep where elliptic ones hold.
"""

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

from forefeel.devices.mujoco.path import Array, Path

STEP_S = 5e-4
_SETTLE_S = 0.5
_CONTACT = 'solref=".001 1" solimp=".01 .95 .00005"'
_HINGE_S, _DAMPED = 2e-3, 0.2  # root of inertia by spring of a hinge, and its damping ratio
_SOFT_M, _SOFT = 0.03, 0.1  # length of the tapered tip, and the share of EI that is left at its end
_KG_M = 0.01  # of the wire, some ten times a real one: 1 to 2 g in all
_HOLDER_KG, _CELL_N_M, _CELL_N_S_M = 0.01, 5e3, 7.0
_OUT_M, _OUT_OF_RADIUS = 5e-5, 0.1


class EscapedError(Exception):
    """The wire has left its vessel: what the engine says from there on is no physics."""


@dataclass(frozen=True)
class WireChain:
    """Bending stiffness (N m2), radius, length, and length of a segment."""

    stiffness_n_m2: float
    radius_m: float
    length_m: float
    segment_m: float = 3e-3
    soft_tip: bool = True

    @property
    def segments(self) -> int:
        return round(self.length_m / self.segment_m)

    @property
    def springs_n_m(self) -> Array:
        """One a hinge. The first stands for half a segment: the wire is clamped there."""
        s = np.arange(self.segments) * self.segment_m
        share = np.clip((self.length_m - s) / _SOFT_M, 0.0, 1.0) if self.soft_tip else np.ones_like(s)
        springs = self.stiffness_n_m2 / self.segment_m * (_SOFT + (1.0 - _SOFT) * share)
        springs[0] *= 2.0
        return np.asarray(springs)


class Guidewire:
    """The wire along the centre line of its vessel, without tension; `path` None: in the open."""

    def __init__(self, wire: WireChain, path: Path | None, friction: float, step_s: float = STEP_S) -> None:
        self._wire, self._path = wire, path
        self.model = mujoco.MjModel.from_xml_string(_mjcf(wire, path, friction, step_s))
        self.data = mujoco.MjData(self.model)
        self.period_s = step_s
        self.worst_m = 0.0  # beyond the wall, so far
        if path is not None:
            middles = (np.arange(self.model.njnt - 1) + 0.5) * wire.segment_m
            self.data.qpos[1:] = [b - a for a, b in pairwise([0.0, *(path.at(s)[2] for s in middles)])]
        mujoco.mj_kinematics(self.model, self.data)

    def settle(self) -> None:
        """Steps for 0.5 s with the stage at rest, while the wire's springs grow from nothing."""
        springs, count = self._wire.springs_n_m, round(_SETTLE_S / self.model.opt.timestep)
        for i in range(count):
            self.model.jnt_stiffness[1:] = springs * min(1.0, 2.0 * (i + 1) / count)
            self._push(0.0, 0.0)

    def step(self, position_m: float, velocity_m_s: float) -> float:
        """Steps the wire; returns the force in N with which the stage pushed at the beginning of the step.
        Raises EscapedError: the wire has left the vessel, or a force that is no number.
        """
        force_n = self._push(position_m, velocity_m_s)
        if self._path is not None:
            deepest = -float(np.min(self.data.contact.dist, initial=0.0))
            self.worst_m = max(self.worst_m, deepest, self._path.outside_m(self.nodes, self._wire.radius_m))
        if not (self.worst_m < _OUT_M + _OUT_OF_RADIUS * self._wire.radius_m and np.isfinite(force_n)):
            raise EscapedError(f"{1e3 * self.worst_m:.3f} mm outside at {self.data.time:.3f} s")
        return force_n

    def _push(self, position_m: float, velocity_m_s: float) -> float:
        data = self.data
        stretch = _CELL_N_M * (position_m - data.qpos[0])
        data.qfrc_applied[0] = stretch + _CELL_N_S_M * (velocity_m_s - data.qvel[0])
        mujoco.mj_step(self.model, data)
        return float(data.qfrc_applied[0])

    def shape_m(self) -> list[tuple[float, float, float]]:
        return [(x, y, 0.0) for x, y in self.nodes.tolist()]

    @property
    def nodes(self) -> Array:
        """Hinges and tip, shape (segments + 1, 2)."""
        return np.vstack([self.data.xpos[2:, :2], self.data.site_xpos[0, :2]])


def _mjcf(wire: WireChain, path: Path | None, friction: float, step_s: float) -> str:
    """MJCF text of the wire, a chain of hinged capsules on a slide, and of the walls, if there is a path."""
    springs, segment = wire.springs_n_m, wire.segment_m
    mass, inertia = _KG_M * segment, _KG_M * segment**3 / 12.0
    armature = wire.stiffness_n_m2 / segment * _HINGE_S**2
    walls = "" if path is None else "".join(
        f'<geom fromto="{x0} {y0} 0 {x1} {y1} 0" size="{radius}" contype="2" conaffinity="1"/>'
        for x0, y0, x1, y1, radius in path.bars()
    )  # fmt: skip
    chain = "".join(
        f'<body pos="{segment if i else 0.0} 0 0">'
        f'<joint axis="0 0 1" stiffness="{spring}" damping="{2.0 * _DAMPED * np.sqrt(spring * armature)}" '
        f'armature="{armature}"/>'
        f'<inertial pos="{segment / 2.0} 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>'
        f'<geom fromto="0 0 0 {segment} 0 0" size="{wire.radius_m}" contype="1" conaffinity="2"/>'
        for i, spring in enumerate(springs)
    )
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step_s}" gravity="0 0 0" integrator="implicitfast" cone="elliptic" impratio="1000">
    <flag autoreset="disable"/>
  </option>
  <default><geom type="capsule" friction="{friction} 0 0" {_CONTACT}/></default>
  <worldbody>
    {walls}
    <body>
      <inertial pos="0 0 0" mass="{_HOLDER_KG}" diaginertia="1 1 1"/>
      <joint type="slide" axis="1 0 0"/>
      {chain}<site pos="{segment} 0 0"/>{"</body>" * len(springs)}
    </body>
  </worldbody>
</mujoco>"""
