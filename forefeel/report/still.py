"""The instrument in its vessel at one moment of a run; vessel.js of the live page draws it."""

import numpy as np

from forefeel.common.messages import Grip
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import SLAVE_STATE
from forefeel.dashboard.vessel import friction, of_recording
from forefeel.report.drawing import Figure
from forefeel.report.score import scored
from forefeel.report.traces import AxisTraces


def still(run: Run, axis: str, traces: AxisTraces) -> Figure | None:
    """When the late force was furthest from the measured one; None where the tip's place is not known."""
    vessel, of, known = of_recording(run.metadata), traces.commands, traces.parameters
    rows = np.flatnonzero(scored(of.predicted_n, of.zoh_n, of.force_n))
    # what was gripped anew is inserted by another length
    regripped = any(state.gripper is Grip.OPEN for state in run.messages(axis, SLAVE_STATE))
    if vessel is None or vessel.axis != axis or regripped or not len(rows):
        return None
    row = rows[np.argmax(np.abs(of.zoh_n - of.force_n)[rows])]
    reported_s = of.time_s[row] - np.nanmedian(traces.force_age_s)
    tip_m = np.interp(reported_s, traces.readback_time_s, traces.readback_m)
    most_mn, felt_mn = (1e3 * np.nanmax(np.abs(each)) for each in (of.zoh_n, of.rendered_n))
    spec = {
        "vessel": vessel.model_dump(mode="json"),
        "reach_mm": [1e3 * end(of.position_m) + vessel.tip_mm for end in (np.nanmin, np.nanmax)],
        "tip_mm": 1e3 * tip_m + vessel.tip_mm,
        "commanded_mm": 1e3 * of.position_m[row] + vessel.tip_mm,
        "predicted_mn": 1e3 * of.predicted_n[row],
        "felt_mn": 1e3 * of.rendered_n[row],
        "measured_mn": 1e3 * of.zoh_n[row],
        "late_ms": round(1e3 * np.median(traces.delay_s)),
        "most_mn": most_mn,
        "most_felt_mn": felt_mn,
        **(friction(known.names, known.values[-1], known.standard_deviations[-1]) if known else {}),
    }
    caption = (
        f"At {of.time_s[row]:.1f} s, when the late force was furthest from the measured one of the same "
        "command. Dashed: where the hand had the tip by then. Friction: as known at the end of the run."
    )
    return Figure("In the vessel", caption, 168, (spec,))
