"""The four things that can happen to the predictor: a motion, a force, a question, a restart."""

import math

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.forecast import band as bands
from forefeel.common.estimation.forecast import bank as banks
from forefeel.common.estimation.forecast import change as changes
from forefeel.common.estimation.forecast import experts as crowd
from forefeel.common.estimation.forecast import hold as holds
from forefeel.common.estimation.forecast import regression as fits
from forefeel.common.estimation.forecast import trial as trials
from forefeel.common.estimation.forecast.bank import RING, Array
from forefeel.common.estimation.forecast.regressors import fill
from forefeel.common.estimation.forecast.state import Memory, State
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.jit import kernel

_RATE_MEMORY_S = 60.0
_RATE_MARGIN = 1.2
_FIRST = 3
"""So many forces tell a median; nothing is learned before.

Later a force out of reach waits until the next one has confirmed it, and is dropped when that one does not.
"""

States = NDArray[np.void]
"""One state, in an array of length 1."""


@kernel
def move(states: States, t: float, x: float, identified_n: float, loaded_n: float) -> bool:
    """One sample of the own motion, and what the models from outside say of it (NaN without one).

    False when it is not finite, or not later than the last.
    """
    return _move(states[0], t, x, identified_n, loaded_n)


@kernel
def observe(states: States, stamp: float, force_n: float) -> bool:
    """A force that has arrived; False when the predictor is to begin anew, see `trial`."""
    _observe(states[0], stamp, force_n)
    good: bool = states[0].trial.failed == 0.0
    return good


@kernel
def predict(states: States, out: Array) -> bool:
    """Writes (force, half width of the band, leading expert or -1 for the hold) for the newest sample.

    False before any force and any motion.
    """
    return _predict(states[0], out)


@kernel
def restart(states: States) -> None:
    """The next sample begins a new piece of motion."""
    states[0].bank.restart = 1.0


@kernel
def _move(state: State, t: float, x: float, identified_n: float, loaded_n: float) -> bool:
    bank, memory = state.bank, state.memory
    if not banks.advance(bank, t, x):
        return False
    fill(bank)
    n = int(bank.count) - 1
    i = n % RING
    memory.forces_n[i] = memory.sayings_n[i] = np.nan
    state.experts.outside_n[i, 0], state.experts.outside_n[i, 1] = identified_n, loaded_n
    if memory.newest >= 0.0 and n - memory.newest >= RING:
        memory.newest = -1.0
    fits.forget_renewed(state.regression, bank)
    return True


@kernel
def _observe(state: State, stamp: float, force_n: float) -> None:
    memory = state.memory
    if not (math.isfinite(force_n) and math.isfinite(stamp)):
        return
    n = banks.find(state.bank, stamp)
    if n >= 0 and not math.isnan(memory.forces_n[n % RING]):
        return
    if n >= 0:
        memory.forces_n[n % RING] = force_n
    _see(memory, force_n)
    if memory.known == _FIRST:
        state.regression.force0_n = memory.held_n = memory.low_n
        memory.said_s = -np.inf
    if _within_reach(memory, memory.suspect_n):
        _take_in(state, memory.suspect_s, memory.suspect_n)
    memory.suspect_n = np.nan
    if memory.known < _FIRST or _within_reach(memory, force_n):
        _take_in(state, stamp, force_n)
    else:
        memory.suspect_s, memory.suspect_n = stamp, force_n


@kernel
def _within_reach(memory: Memory, force_n: float) -> bool:
    """Whether a force is beyond the range of those seen by no more than the range; False for NaN."""
    range_n = memory.high_n - memory.low_n
    return memory.low_n - range_n <= force_n <= memory.high_n + range_n


@kernel
def _take_in(state: State, stamp: float, force_n: float) -> None:
    """Holds a force that is believed, learns from it, and judges what was said of its sample."""
    memory, n = state.memory, banks.find(state.bank, stamp)
    paired_s = memory.newest_s if memory.newest >= 0.0 else -np.inf
    if stamp > memory.newest_s and (n >= 0 or stamp > paired_s + GAP_S):
        memory.newest_s, memory.held_n, memory.newest = stamp, force_n, float(n)
    if n >= 0:
        _see_rate(state, n, force_n)
    if n >= 0 and memory.known >= _FIRST:
        fits.learn(state.regression, state.bank, n, force_n)
        if not math.isnan(memory.sayings_n[n % RING]):
            _judge(state, n, force_n)


@kernel
def _see(memory: Memory, force_n: float) -> None:
    """Range of the forces, in the order in which they arrive.

    The range begins with the median of the first three; a single force far out widens it when the next one
    confirms it, and not before.
    """
    memory.known += 1.0
    if memory.known < _FIRST:
        first = memory.known == 1.0
        memory.low_n = force_n if first else min(force_n, memory.low_n)
        memory.high_n = force_n if first else max(force_n, memory.high_n)
        memory.before_n = force_n
        return
    if memory.known == _FIRST:
        memory.low_n = memory.high_n = max(memory.low_n, min(memory.high_n, force_n))
    memory.low_n = min(memory.low_n, max(force_n, memory.before_n))
    memory.high_n = max(memory.high_n, min(force_n, memory.before_n))
    memory.before_n = force_n


@kernel
def _see_rate(state: State, n: int, force_n: float) -> None:
    """How fast the force changes between sample n and its neighbours, in whatever order they arrived."""
    bank, memory = state.bank, state.memory
    memory.fastest_n_s *= math.exp(-bank.period_s / _RATE_MEMORY_S)
    for k in (n - 1, n + 1):
        if k < 0 or k >= bank.count or bank.count - k > RING:
            continue
        dt, other_n = abs(bank.t_s[n % RING] - bank.t_s[k % RING]), memory.forces_n[k % RING]
        if dt <= GAP_S and _within_reach(memory, other_n):
            memory.fastest_n_s = max(memory.fastest_n_s, abs(force_n - other_n) / dt)


@kernel
def _judge(state: State, n: int, force_n: float) -> None:
    """What was said of sample n against its force."""
    memory, i = state.memory, n % RING
    range_n = memory.high_n - memory.low_n
    w = min(max(state.bank.period_s, 1e-4), 0.05)
    needed_n = force_n - memory.holds_n[i]
    misfit_n = crowd.plain_error_n(state.experts, n, force_n)
    crowd.judge(state.experts, n, force_n, needed_n, range_n, w)
    kick = changes.noticed(state.change, misfit_n, range_n, w)
    holds.learn(state.gain, memory.blends_n[i] - memory.holds_n[i], needed_n, w)
    if not fits.at_rest(state.bank, n):
        trials.judge(state.trial, force_n, memory.sayings_n[i], memory.holds_n[i], w)
    bands.learn(state.band, force_n - memory.sayings_n[i], memory.halves_n[i], memory.scales_n[i], w)
    if kick:
        fits.discount(state.regression)
        crowd.discount(state.experts)
        holds.discount(state.gain)


@kernel
def _predict(state: State, out: Array) -> bool:
    memory, n = state.memory, int(state.bank.count) - 1
    if memory.known == 0.0 or n < 0:
        return False
    t, held_n = state.bank.t_s[n % RING], memory.held_n
    range_n, widest_n = memory.high_n - memory.low_n, state.gain.largest_error_n
    blend_n, leading, deviation_n, spread_n2 = held_n, -1, 0.0, 0.0
    paired = memory.newest >= 0.0
    if paired:
        blend_n, leading = _blend(state, n)
        age_s, taught = t - memory.newest_s, crowd.taught(state.experts)
        deviation_n = holds.applied(state.gain, blend_n - held_n, age_s, range_n, taught)
    force_n = _without_a_jump(memory, t, held_n + deviation_n)
    if paired:
        spread_n2 = crowd.spread(state.experts, n, force_n)
    scale_n = bands.scale_n(state.band, spread_n2, deviation_n, range_n)
    half_n = bands.half_width_n(state.band, scale_n, widest_n, range_n)
    if paired:
        _keep(memory, n, blend_n, force_n, half_n, scale_n)
    led = abs(deviation_n) > 0.5 * abs(blend_n - held_n)
    out[0], out[1], out[2] = force_n, half_n, leading if led else -1
    return True


@kernel
def _blend(state: State, n: int) -> tuple[float, int]:
    """(what the experts say together, who leads) of sample n; the held force before anybody was judged."""
    memory = state.memory
    range_n = memory.high_n - memory.low_n
    crowd.predict(state.experts, state.regression, state.bank, n, int(memory.newest), memory.held_n)
    crowd.clip(state.experts, n, memory.low_n - range_n, memory.high_n + range_n)
    if state.experts.seen_fast > 0.0:
        return crowd.blend(state.experts, n)
    return memory.held_n, -1


@kernel
def _keep(memory: Memory, n: int, blend_n: float, force_n: float, half_n: float, scale_n: float) -> None:
    """What is said of sample n, until its force arrives."""
    i = n % RING
    memory.blends_n[i], memory.holds_n[i] = blend_n, memory.held_n
    memory.sayings_n[i], memory.halves_n[i], memory.scales_n[i] = force_n, half_n, scale_n


@kernel
def _without_a_jump(memory: Memory, t: float, force_n: float) -> float:
    """`force_n`, or as near to it as forces have been seen to change since the last prediction."""
    dt = t - memory.said_s
    if 0.0 < dt <= GAP_S and memory.fastest_n_s > 0.0:
        step_n = _RATE_MARGIN * memory.fastest_n_s * dt
        force_n = min(memory.said_n + step_n, max(memory.said_n - step_n, force_n))
    memory.said_n, memory.said_s = force_n, t
    return force_n
