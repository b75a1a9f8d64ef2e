"""The regressors of the contact model at the rows of a fit, cause by cause, as its shape moves."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.base import (
    ContactEffect,
    FactorEffect,
    ForceEffect,
    MotionEffect,
    SensorEffect,
    Site,
)
from forefeel.common.causes.model import EffectEntry
from forefeel.common.causes.motion import Motion
from forefeel.common.causes.runtime import SITES, WallMotion
from forefeel.common.estimation.contact_model import Array, Causes

Pause = Callable[[], object]
"""Called between the pieces of a fit, which take some .05 ms each."""


class _Block(NamedTuple):
    """The columns of one cause at the rows, times sqrt(w), shape (its theta, rows)."""

    entry: EffectEntry
    gate: EffectEntry | None
    effect: ForceEffect
    rows: Array


def motion_of(causes: Causes, samples: Array) -> Motion:
    """Motion of samples of a `Fitting`, with the columns beside by name."""
    return replace(Motion.of(*samples[:5]), further=dict(zip(causes.columns, samples[5:], strict=True)))


class RegressorColumns:
    """Rows of phi times sqrt(w), cause by cause; a cause is computed only if the shape changes it.

    A cause with a memory, or before a sensor with one, is computed on all samples, others on the rows only.
    """

    def __init__(
        self,
        causes: Causes,
        motion: Array,
        rows: NDArray[np.intp],
        root: Array,
        shape: Array,
        pause: Pause,
    ) -> None:
        self._pause = pause
        self._causes, self._rows, self._root = causes, rows, root
        self._origin_s = float(motion[0, -1])
        entries = causes.model(shape, self._origin_s).effects
        effects = [entry.instance() for entry in entries]
        forces = [(i, e, entries[i].site) for i, e in enumerate(effects) if isinstance(e, ForceEffect)]
        sites = [(i, site or effect.site) for i, effect, site in forces]
        self._sites = sorted(sites, key=lambda place: SITES.index(place[1]))
        self._contact = next((i for i, e in enumerate(effects) if isinstance(e, ContactEffect)), None)
        self._sensors = [e for e in effects if isinstance(e, SensorEffect) and e.linear]
        self._factored = any(isinstance(e, FactorEffect) for e in effects)
        stage = instrument = motion_of(causes, motion)
        for effect in effects:
            if isinstance(effect, MotionEffect):
                instrument = effect.moved(instrument)
        self._motions = {"sensor": stage, "shaft": instrument, "wall": instrument}
        self._gate: EffectEntry | None = None
        self._walls: dict[bool, WallMotion] = {}
        self._blocks: dict[int, list[_Block]] = {i: [] for i, _ in self._sites}

    def at(self, shape: Array) -> Array:
        """Returns the regressors phi of all rows times sqrt(w) at a shape, of shape (rows, theta). Computes a
        cause only if the shape changes its parameters or its contact; with a factor effect all.
        """
        model = self._causes.model(shape, self._origin_s)
        if self._factored:  # by the sum of all
            m = self._motions["sensor"]
            columns = model.runtime().columns(m, sensed=True)
            return columns[self._rows] * self._root[:, None]
        gate = None if self._contact is None else model.effects[self._contact]
        if gate != self._gate:
            self._gate, self._walls = gate, {}
        return np.concatenate([self._block(i, model.effects[i], site).rows for i, site in self._sites]).T

    def _block(self, i: int, entry: EffectEntry, site: Site) -> _Block:
        """Returns the columns of effect i at `site`, one of the last two that are kept, or computes them.

        `entry`: its parameters now. Calls `_pause` before it computes.
        """
        recent = self._blocks[i]
        for place, block in enumerate(recent):
            if block.entry == entry and (site != "wall" or block.gate == self._gate):
                recent.insert(0, recent.pop(place))
                return block
        self._pause()
        effect = next((block.effect for block in recent if block.entry == entry), None) or entry.instance()
        assert isinstance(effect, ForceEffect)
        everywhere = effect.remembers or bool(self._sensors)
        if site == "wall":
            columns = self._wall(everywhere).columns(effect)
        else:
            columns = effect.columns(self._motion(site, everywhere))
        for sensor in self._sensors:
            columns = np.stack([sensor.reading(self._motions[site], phi) for phi in columns.T], axis=1)
        rows = (columns[self._rows] if everywhere else columns).T * self._root
        recent[:] = [_Block(entry, self._gate, effect, rows), *recent[:1]]
        return recent[0]

    def _wall(self, everywhere: bool) -> WallMotion:
        """Motion in contact at the present gate, of all samples or of the rows; computed once per gate."""
        if everywhere not in self._walls:
            contact = None if self._gate is None else self._gate.instance()
            assert contact is None or isinstance(contact, ContactEffect)
            self._walls[everywhere] = WallMotion(contact, self._motion("wall", everywhere))
        return self._walls[everywhere]

    def _motion(self, site: Site, everywhere: bool) -> Motion:
        return self._motions[site] if everywhere else self._motions[site][self._rows]
