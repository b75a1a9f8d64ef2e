"""A YAML file as plain data with the line of each place; without pydantic, for a stop waits for no import."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from forefeel.common.errors import ConfigurationError

Place = tuple[int | str, ...]
KINDS = {type(None): "empty", list: "a list", str: "text"}
"""Words for what stands where a mapping was expected."""


class _Loader(yaml.SafeLoader):
    """Safe YAML that also reads 1e-3 as a number (YAML 1.2), as engineers write it.

    Without aliases: a few lines of them, each of the one before, stand for more than any memory holds.
    Without tags: they make of a text whatever they name, or raise what no caller expects.
    """

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:  # noqa: ANN401
        """Composes the next node as PyYAML does; raises yaml.MarkedYAMLError for an alias or a tag."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        alias = self.check_event(yaml.AliasEvent)
        if alias or event.tag is not None:
            what = f"*{event.anchor} is an alias" if alias else f"{event.tag!r:.80} is a tag"
            raise yaml.MarkedYAMLError(None, None, what, event.start_mark)
        return super().compose_node(parent, index)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d[\d_]*)(\.\d*)?[eE][-+]?\d+$"),
    list("-+0123456789"),
)


def load_yaml(path: Path) -> tuple[dict[str, Any], dict[Place, int]]:
    """The mapping in a YAML file, and the line of each place in it.

    Raises:
        ConfigurationError: missing, unreadable, not YAML, a key twice, or not a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: {reason}; expected a readable YAML file") from error
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        lines = dict(_lines(node, (), path)) if node else {}
        data = loader.construct_document(node) if node else None
        repr(data)  # a mistake in it is shown: an integer of over 4300 digits can not be
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark else 1
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
        raise ConfigurationError(f"{path}:{line}: {problem}; expected plain YAML") from error
    except (ValueError, OverflowError, RecursionError) as error:  # no date; 1:1:...:1.0; brackets in brackets
        raise ConfigurationError(f"{path}: {error}; expected YAML") from error
    if not isinstance(data, dict):
        kind = KINDS.get(type(data), f"{data!r:.40}")
        raise ConfigurationError(f"{path}:1: {kind}; expected a mapping of settings")
    return data, lines


def _lines(node: yaml.Node, place: Place, path: Path) -> Iterator[tuple[Place, int]]:
    """Yields each place below `node` with its line; a key's twice, first with the line of its value, last
    with that of the key, which is to win. Raises ConfigurationError: a key that is a list or mapping, or that
    stands twice.
    """
    yield place, node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        for index, child in enumerate(node.value):
            yield from _lines(child, (*place, index), path)
    elif isinstance(node, yaml.MappingNode):
        keys: set[str] = set()
        for key, child in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigurationError(f"{path}:{line}: a {key.id} as key; expected the name of a setting")
            if key.value in keys:
                raise ConfigurationError(
                    f"{path}:{line}: {shown_key(key.value)}: the key stands twice; expected it once"
                )
            keys.add(key.value)
            yield from _lines(child, (*place, key.value), path)
            yield (*place, key.value), line


def shown_key(key: str) -> str:
    """A key on one line, whatever it holds."""
    return repr(key)[1:-1]


def dump_mapping(data: dict[str, Any]) -> str:
    """Plain data as YAML, in the order of its keys."""
    text: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    return text
