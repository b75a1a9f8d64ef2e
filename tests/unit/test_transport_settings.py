from pathlib import Path

import pytest
from pydantic import ValidationError

from forefeel.common.transport.settings import PRESETS, ImpairmentSettings, TransportSettings


@pytest.mark.parametrize("name", PRESETS)
def test_a_name_is_enough(name: str) -> None:
    assert ImpairmentSettings.model_validate(name) == PRESETS[name]


def test_the_paper_s_network() -> None:
    paper = PRESETS["paper"]
    assert (paper.delay_s, paper.jitter_s, paper.loss) == (0.150, 0.010, 0.01)


def test_a_mapping_overrides_its_preset() -> None:
    settings = ImpairmentSettings.model_validate({"preset": "paper", "loss": 0.05})
    assert settings == PRESETS["paper"].model_copy(update={"loss": 0.05})


def test_presets_stay_as_they_are() -> None:
    ImpairmentSettings.model_validate({"preset": "paper", "loss": 0.5})
    assert ImpairmentSettings.model_validate("paper").loss == 0.01


def test_only_none_is_transparent() -> None:
    assert [name for name, settings in PRESETS.items() if settings.transparent] == ["none"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("moon", "preset 'moon' is unknown, expected one of none, lan, wan"),
        ({"preset": 3}, "preset 3 is unknown"),
        ({"delay": 1}, "Extra inputs are not permitted"),
        ({"loss": 1.0}, "less than 1"),
        ({"delay_s": -0.1}, "greater than or equal to 0"),
        ({"delay_s": float("nan")}, "finite number"),
        ({"preset": "none", "jitter_s": 0.01}, "jitter_s = 0.01: expected at most delay_s = 0"),
        ({"burst_loss": 0.9, "burst_length": 2}, "burst_loss = 0.9: expected at most 0.667"),
        (["paper"], "valid dictionary"),
    ],
)
def test_bad_impairments_are_refused(data: object, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ImpairmentSettings.model_validate(data)


def test_a_client_connects_and_does_not_listen() -> None:
    with pytest.raises(ValidationError, match="at least one endpoint in connect"):
        TransportSettings(mode="client")
    with pytest.raises(ValidationError, match="none in listen"):
        TransportSettings(mode="client", connect=("tcp/a:1",), listen=("tcp/b:1",))


def test_the_zenoh_file_counts_from_the_folder_of_the_settings() -> None:
    settings = TransportSettings.model_validate(
        {"zenoh_file": "a.json5"}, context={"directory": Path("/etc/x")}
    )
    assert settings.zenoh_file == Path("/etc/x/a.json5")
    assert TransportSettings.model_validate({"zenoh_file": "a.json5"}).zenoh_file == Path.cwd() / "a.json5"
