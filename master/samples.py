"""Builds the messages of what the hand did and felt, and of the contact model."""

from collections.abc import Iterable, Mapping

from forefeel.common.bus import Header
from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.messages import (
    MOST_COUNT,
    MOST_FORCE_N,
    MOST_NAME,
    MOST_PARAMETER,
    MOST_POSITION_M,
    HapticSample,
    ModelParameters,
    within,
)
from forefeel.master.haptics import HapticInputs, HapticOutputs, NewestForce
from forefeel.master.prediction import IdentificationTask


def ages_s(
    now_ns: int, force: NewestForce | None, clock: OffsetEstimate | None
) -> tuple[float | None, float | None]:
    """Age in s of the newest force, and round trip in s of the command that it answers. None: both without a
    force, the age while the clocks are not compared, the round trip where it answers no command.
    """
    if force is None:
        return None, None
    sample = force.sample
    age_s = None if clock is None else (now_ns - sample.stamp_ns + clock.offset_ns) * 1e-9
    sent_ns = sample.answers_stamp_ns
    return age_s, None if sent_ns is None else (force.arrived_ns - sent_ns) * 1e-9


def haptic_sample(
    header: Header,
    inputs: HapticInputs,
    outputs: HapticOutputs,
    rendered_n: float,
    clock: OffsetEstimate | None,
    forces: tuple[int, ...],
    slave_state: int | None,
) -> HapticSample:
    """Builds the haptic sample of one tick; fields of the prediction or of the newest force are None where
    there is none (`leading`: empty). Clips command position and prediction to the range of the messages.
    `rendered_n`: as the handle applied it. `forces`: numbers of the force samples that it names;
    `slave_state`: number of the state whose reaction times are in use.
    """
    predicted, force, snapshot = outputs.predicted, inputs.force, inputs.snapshot
    force_n, low_n, high_n = bounded(predicted[:3]) if predicted else (None, None, None)
    age_s, delay_s = ages_s(header["stamp_ns"], force, clock)
    return HapticSample(
        **header,
        handle_position_m=inputs.reading.position_m,
        command_position_m=within(outputs.position_m, MOST_POSITION_M),
        predicted_n=force_n,
        low_n=low_n,
        high_n=high_n,
        leading=predicted.leading if predicted else "",
        zoh_n=outputs.zoh_n,
        rendered_n=rendered_n,
        force_age_s=age_s,
        delay_s=delay_s,
        answered_sequence=force.sample.answers_sequence if force else None,
        limited=bool(outputs.hits),
        energy_j=outputs.energy_j,
        forces=forces,
        snapshot=snapshot.number,
        snapshot_forces=snapshot.forces,
        fit_late=snapshot.fit_late,
        slave_state=slave_state,
    )


def saturated(counters: Mapping[str, int]) -> dict[str, int]:
    """Counters cut to what a state may carry: some of the names and numbers come from the slave."""
    return {name[:MOST_NAME]: min(count, MOST_COUNT) for name, count in counters.items()}


def bounded(forces_n: Iterable[float]) -> list[float]:
    return [within(force_n, MOST_FORCE_N) for force_n in forces_n]


def model_parameters(header: Header, identification: IdentificationTask, prior: str) -> ModelParameters:
    """Builds the message of the contact model (empty and not valid until there is one) and of the learning so
    far. `prior`: one line on its origin, cut to 256 characters.
    """
    contact, learned = identification.snapshot.contact, identification.snapshot.learned
    model = identification.learner.model
    return ModelParameters(
        **header,
        names=contact.names if contact else (),
        values=_parameters(contact.values if contact else ()),
        standard_deviations=_parameters(contact.standard_deviations if contact else ()),
        identifiable=contact.identifiable if contact else (),
        valid=contact is not None,
        samples=identification.used,
        updates=identification.learner.fits,
        resets=identification.learner.renewals,
        innovation_rms_n=within(float(learned.values["recent_n"]), MOST_FORCE_N),
        prior=prior[:256],
        model=tuple(entry.effect for entry in model.effects) if model else (),
    )


def _parameters(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(within(value, MOST_PARAMETER) for value in values)
