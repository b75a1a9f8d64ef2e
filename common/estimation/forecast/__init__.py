"""The force now, from the own motion up to now and forces that arrive late.

What happens, in the order of the modules: `bank` keeps the motion; `regressors` says what it may do to a
force; `regression` fits late forces to that; `experts` predict, each in its way, and are weighed by errors
that were seen; `hold` draws the blend to the newest force where that has been the better one; `band` says how
far off it may be; `change` notices when the contact has become another; `trial` when nothing that was learned
is worth keeping. All of it is causal, has no unit of its own and starts knowing nothing. `steps` puts it
together, on one record of `state`; `forecaster` is what others use.
"""

from forefeel.common.estimation.forecast.forecaster import Estimate, Forecaster, compile_kernels

__all__ = ["Estimate", "Forecaster", "compile_kernels"]
