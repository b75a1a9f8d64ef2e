"""Settings of the simulated world. A preset gives every value; a file overrides what it names."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, PlainSerializer, PlainValidator, SerializeAsAny, ValidationInfo, model_validator

from forefeel.common.causes.model import ContactModel
from forefeel.common.config import Settings, checked, deep_merge
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.driver import driver_settings
from forefeel.common.model_file import load_model
from forefeel.slave.plant.foreign import WorldDriverSettings
from forefeel.slave.plant.presets import PRESETS

PresetName = Literal["catheter", "guidewire"]
Position = Annotated[float, Field(ge=-1.0, le=1.0)]


def _contact(value: object) -> ContactModel:
    return value if isinstance(value, ContactModel) else ContactModel.from_mapping(value)


Contact = Annotated[
    ContactModel,
    PlainValidator(_contact),
    PlainSerializer(ContactModel.to_mapping, return_type=dict[str, Any]),
]


class StageSettings(Settings):
    """The drive: a second-order servo with limits. It stops `device_watchdog_s` after the last setpoint.

    Play is an effect of the contact, `backlash` or `play`.
    """

    travel_lower_m: Position
    travel_upper_m: Position
    start_m: Position
    bandwidth_hz: Annotated[float, Field(ge=1.0, le=200.0)]
    velocity_limit_m_s: Annotated[float, Field(gt=0.0, le=10.0)]
    acceleration_limit_m_s2: Annotated[float, Field(gt=0.0, le=1000.0)]
    encoder_step_m: Annotated[float, Field(gt=0.0, le=1e-3)]
    device_watchdog_s: Annotated[float, Field(ge=0.005, le=1.0)]

    @model_validator(mode="after")
    def _starts_within_travel(self) -> Self:
        low, high = self.travel_lower_m, self.travel_upper_m
        if not (low < high and low <= self.start_m <= high):
            raise ValueError(f"start_m = {self.start_m}: expected within travel [{low}, {high}], low < high")
        return self


class FixtureSettings(Settings):
    """The grip: the length of instrument already inserted at the start, held by the closed fixture."""

    inserted_m: Position


class LoadCellSettings(Settings):
    """The sensor chain: anti-alias filter, offset, drift, white noise of the conversion, counts.

    `pushes_only`: see the load cell's setting; on with the contact of a preset, off with any other.
    """

    full_scale_n: Annotated[float, Field(gt=0.0, le=1000.0)]
    bits: Annotated[int, Field(ge=8, le=32)]
    filter_hz: Annotated[float, Field(ge=1.0, le=5000.0)]
    noise_n: Annotated[float, Field(ge=0.0, le=10.0)]
    bias_n: Annotated[float, Field(ge=-100.0, le=100.0)]
    drift_n_s: Annotated[float, Field(ge=-1.0, le=1.0)]
    pushes_only: bool = False


class HiddenSettings(Settings):
    """Effects that are switched on in the world at `from_s` of its time, beside its contact's own.

    `model`: a model.yaml that is read as the effects; the effective settings then show what stood in it.
    """

    effects: Contact
    from_s: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    model: Path | None = None

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:  # noqa: ANN401 - raw input of pydantic
        return _with_model(data, "effects", info) if isinstance(data, dict) else data


class WorldSettings(Settings):
    """The simulated world of one axis. What a mapping leaves out comes from its preset, value by value.

    A list is replaced as a whole: `contact: {effects: [...]}` gives all effects. `model`: a model.yaml that
    is read as the contact; the effective settings then show what stood in it. `world`: an engine whose force
    takes the place of the preset's contact; effects that are given act beside it. `hidden`: what is switched
    on during the run.
    """

    preset: PresetName = "catheter"
    stage: StageSettings
    fixture: FixtureSettings
    contact: Contact
    load_cell: LoadCellSettings
    model: Path | None = None
    hidden: HiddenSettings | None = None
    world: Annotated[SerializeAsAny[WorldDriverSettings] | None, driver_settings("world", optional=True)] = (
        None
    )

    @model_validator(mode="after")
    def _one_contact(self) -> Self:
        """Raises ValueError where the contact's and the hidden effects together are no contact model."""
        if self.hidden is not None:
            together = self.contact.effects + self.hidden.effects.effects
            _contact(ContactModel(self.contact.name, together).to_mapping())
        return self

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, data: Any, info: ValidationInfo) -> Any:  # noqa: ANN401 - raw input of pydantic
        """Fills in from its preset what the raw mapping leaves out; the contact from the file `model`, if it
        names one, else with a `world` none. `pushes_only` defaults to on only with the preset's contact.
        Anything but a mapping with a known preset is passed on for the fields to refuse.
        """
        if not isinstance(data, dict):
            return data
        data = _with_model(data, "contact", info)
        if data.get("world") is not None and "contact" not in data:
            data = {**data, "contact": ContactModel("the world's alone", ()).to_mapping()}
        name = data.get("preset", "catheter")
        values = PRESETS.get(name) if isinstance(name, str) else None  # any other is refused by its field
        if values is None:
            return data
        pushes_only = {"load_cell": {"pushes_only": "contact" not in data}}
        return deep_merge(deep_merge(values, pushes_only), data)


def _with_model(data: dict[str, Any], key: str, info: ValidationInfo) -> dict[str, Any]:
    """Copy of `data` with the contact of the file `model` under `key`, and `model` None; `data` itself where
    it names no file. ValueError: `key` is given as well, or the file can not be used.
    """
    model = data.get("model")
    if not isinstance(model, str | Path):
        return data
    if key in data:
        raise ValueError(f"model and {key}: expected one of them, both say what is touched")
    directory = (info.context or {}).get("directory", Path())
    try:
        contact = load_model(directory / model)
    except ConfigurationError as error:
        raise ValueError(str(error)) from error
    return {**data, "model": None, key: contact.to_mapping()}


def world_settings(mapping: Mapping[str, Any]) -> WorldSettings:
    """The settings that a mapping such as `{preset: guidewire, load_cell: {noise_n: 0.001}}` describes.

    Raises:
        ConfigurationError: unknown key, or a value out of range; one line.
    """
    return checked(WorldSettings, dict(mapping), "world")


def preset(name: PresetName) -> WorldSettings:
    return world_settings({"preset": name})
