"""Any MuJoCo model as the world: one drive is the carriage, one sensor is the load cell."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from forefeel.common.errors import ConfigurationError
from forefeel.devices.mujoco.settings import MujocoSettings

_PERIOD_S = 1e-3
_Kind = mujoco.mjtObj
_OF_JOINT = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT


class MujocoModel:
    """The model of an MJCF file, its drive at `inserted_m`.

    Attributes:
        period_s: of a step, in which the model makes a whole number of its own.
    """

    def __init__(self, settings: MujocoSettings) -> None:
        """Raises ConfigurationError: MuJoCo can not read the model, or it has no such drive, sensor, body,
        or no such timestep.
        """
        self._settings, self._file = settings, settings.model
        try:
            self._model = mujoco.MjModel.from_xml_path(str(self._file))
        except ValueError as error:
            first, *_ = str(error).splitlines()
            raise ConfigurationError(f"{self._file}: {first}; expected an MJCF model") from error
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # it would look like physics
        self._data = mujoco.MjData(self._model)
        self.period_s, self._step_s = _PERIOD_S, float(self._model.opt.timestep)
        self._steps = round(_PERIOD_S / self._step_s)
        if self._steps < 1 or abs(self._steps * self._step_s - _PERIOD_S) > 1e-9:
            raise ConfigurationError(
                f"{self._file}: timestep = {self._step_s:g}; expected a whole part of 1 ms"
            )
        self._actuator, joint = self._drive()
        self._at, self._speed_at = self._model.jnt_qposadr[joint], self._model.jnt_dofadr[joint]
        sensor = self._named(_Kind.mjOBJ_SENSOR, "force", settings.force)
        several = self._model.sensor_dim[sensor] > 1
        self._cell = self._model.sensor_adr[sensor] + (settings.force_axis if several else 0)
        self._drawn = self._descendants()
        self._start_m: float | None = None
        self._insert()

    def step(self, position_m: float, velocity_m_s: float) -> float:
        """Steps the model by a period, in which the drive goes where the carriage is, counted from the
        position of the first call; returns the force on the cell in N. Raises FloatingPointError: bodies
        overlap by more than `overlap_m`, or the force is no number.
        """
        if self._start_m is None:
            self._start_m = position_m
        unit = self._settings.unit_m
        q, v = self._inserted + (position_m - self._start_m) / unit, velocity_m_s / unit
        for left in range(self._steps - 1, -1, -1):
            self._move(q - v * left * self._step_s, v)
        overlap_m = -unit * float(np.min(self._data.contact.dist, initial=0.0))
        force_n = self._settings.force_sign * unit * float(self._data.sensordata[self._cell])
        if not (overlap_m <= self._settings.overlap_m and np.isfinite(force_n)):
            raise FloatingPointError(
                f"bodies overlap by {1e3 * overlap_m:.2g} mm at {self._data.time:.3f} s: no physics from here"
            )
        return force_n

    def shape_m(self) -> list[tuple[float, float, float]]:
        """Origins of `shape` and of the bodies below it; none without it."""
        points = self._settings.unit_m * self._data.xpos[self._drawn]
        return [(x, y, z) for x, y, z in points.tolist()]

    def _named(self, kind: int, key: str, name: str) -> int:
        """Number of the sensor or body `name` in the model. Raises ConfigurationError, with the names that
        there are: none is called so; `key`: the setting.
        """
        number = int(mujoco.mj_name2id(self._model, kind, name))
        if number < 0:
            count = {_Kind.mjOBJ_SENSOR: self._model.nsensor, _Kind.mjOBJ_BODY: self._model.nbody}[kind]
            known = ", ".join(filter(None, (mujoco.mj_id2name(self._model, kind, i) for i in range(count))))
            raise ConfigurationError(f"{self._file}: {key} = {name!r}; expected one of {known or '(none)'}")
        return number

    def _drive(self) -> tuple[int, int]:
        """Numbers of the actuator that `drive` names and of its joint, else -1 and that of the joint of this
        name. Raises ConfigurationError: there is neither, or an actuator of something else than a joint.
        """
        name = self._settings.drive
        actuator = int(mujoco.mj_name2id(self._model, _Kind.mjOBJ_ACTUATOR, name))
        joint = int(mujoco.mj_name2id(self._model, _Kind.mjOBJ_JOINT, name))
        if actuator >= 0:  # of a tendon, site or body the number would be taken for that of a joint
            of_joint = self._model.actuator_trntype[actuator] in _OF_JOINT
            joint = int(self._model.actuator_trnid[actuator, 0]) if of_joint else -1
        if joint < 0:
            raise ConfigurationError(f"{self._file}: drive = {name!r}; expected an actuator or a joint of it")
        return actuator, joint

    def _insert(self) -> None:
        """Steps the model for `settle_s` of its time: moves the drive by `inserted_m`, then lets it settle
        there, and stores that position. The constructor calls it, for a tick of a loop is too short.
        """
        start = float(self._data.qpos[self._at])
        way = self._settings.inserted_m / self._settings.unit_m
        count = int(self._settings.settle_s / self._step_s)
        for i in range(count):
            self._move(start + way * min(1.0, 1.25 * (i + 1) / count), 0.0)
        self._inserted = start + way

    def _move(self, q: float, v: float) -> None:
        """Makes one step of the engine, at the end of which the drive is at q (and a joint moves at v)."""
        if self._actuator >= 0:
            self._data.ctrl[self._actuator] = q
        else:
            self._data.qpos[self._at], self._data.qvel[self._speed_at] = q - v * self._step_s, v
        mujoco.mj_step(self._model, self._data)

    def _descendants(self) -> NDArray[np.int64]:
        """Numbers of the body `shape` and of those below it, which come after it; none without `shape`."""
        if self._settings.shape is None:
            return np.empty(0, dtype=np.int64)
        below = {self._named(_Kind.mjOBJ_BODY, "shape", self._settings.shape)}
        for body in range(1, self._model.nbody):
            if int(self._model.body_parentid[body]) in below:
                below.add(body)
        return np.array(sorted(below))
