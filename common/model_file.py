"""A contact model from a model.yaml."""

from pathlib import Path

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError
from forefeel.common.yaml_file import load_yaml


def load_model(path: Path) -> ContactModel:
    """The model that the file holds.

    Raises:
        ConfigurationError: the file is no YAML, or no model of schema `forefeel.model/1`.
    """
    mapping, _ = load_yaml(path)
    try:
        return ContactModel.from_mapping(mapping)
    except ValueError as error:
        raise ConfigurationError(f"{path}: {error}") from error
