"""Zenoh configuration files of every role: for zenohd, for Zenoh's tools, for `transport.zenoh_file`."""

import json
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from forefeel.common.transport.pki import AUTHORITY
from forefeel.common.transport.security import CELL_ROLES, Party, PartyFiles, secured
from forefeel.common.transport.zenoh_config import FIXED

_HEAD = (
    "// Written by `forefeel pki rules`; change the topic table, the cells or the folder and write it anew.\n"
)
_LISTEN = "tls/0.0.0.0:7447"


def zenoh_files(cells: Sequence[str], folder: PurePath) -> dict[str, str]:
    """The texts by file name: of a router for all cells, and of each role of each cell.

    `folder`: where each host keeps its certificates.
    """
    parties = [Party(role, (cell,)) for cell in cells for role in CELL_ROLES]
    router = Party("router", tuple(cells))
    texts = {_file(party, len(cells) > 1): _text(party, folder, {}) for party in parties}
    return texts | {"router.json5": _text(router, folder, {"listen/endpoints": [_LISTEN]})}


def _file(party: Party, apart: bool) -> str:
    return f"{party.cells[0]}-{party.role}.json5" if apart else f"{party.role}.json5"


def _text(party: Party, folder: PurePath, added: Mapping[str, object]) -> str:
    files = PartyFiles(folder / AUTHORITY, folder / f"{party.role}.crt", folder / f"{party.role}.key")
    mode = "router" if party.role == "router" else "peer"
    paths = {"mode": mode, **added, **FIXED, **secured(party, files)}
    return f"{_HEAD}{json.dumps(_nested(paths), indent=2)}\n"


def _nested(paths: Mapping[str, object]) -> dict[str, Any]:
    """`a/b: value` as `{a: {b: value}}`."""
    tree: dict[str, Any] = {}
    for path, value in paths.items():
        *above, last = path.split("/")
        inside = tree
        for name in above:
            inside = inside.setdefault(name, {})
        inside[last] = value
    return tree
