"""The pages of the reference, made from the code; they are never committed."""

from docs.hooks import causes, command_line, configuration, messages
from docs.hooks.markdown import NOTE

_INDEX = f"""{NOTE}
# Reference

Made from the code when this site is built, so it can not be older than the code.

- [Configuration](configuration.md): every setting of every file, with unit, range and default.
- [Causes](causes.md): every cause that a diagnosis names, with its equation, what shows it, and its source.
- [Messages and topics](messages.md): what crosses the network, how often, and when it is stale.
- [Command line](command-line.md): every command with its options.
"""


def pages() -> dict[str, str]:
    """Path below docs/ -> Markdown."""
    return {
        "reference/index.md": _INDEX,
        "reference/configuration.md": configuration.page(),
        "reference/causes.md": causes.page(),
        "reference/messages.md": messages.page(),
        "reference/command-line.md": command_line.page(),
    }
