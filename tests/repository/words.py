"""`python -m tests.repository.words`: docstrings that begin with a relative word, names that name nothing."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

RELATIVE = {"What", "Whether", "How", "Of", "Who", "Why", "Where", "As", "Whom", "Whose", "Which"}
NAMELESS = {"found", "said", "told", "heard", "kept", "own", "seen", "each", "standing"}
PRODUCT = "common", "master", "slave", "src"
SERIALISED = {("src/forefeel/doctor/checks.py", "found")}
"""Keys of JSON, which stay."""
DEFINITIONS = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def complaints(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        at = f"{path}:{getattr(node, 'lineno', 1)}"
        text = ast.get_docstring(node) if isinstance(node, DEFINITIONS | ast.Module) else None
        first, *_ = (text or "-").split()
        if first.strip("`,.:*") in RELATIVE:
            yield f"{at}: docstring begins with {first}: expected a noun, or a verb of the effect"
        name = (
            node.name if isinstance(node, DEFINITIONS)
            else node.arg if isinstance(node, ast.arg)
            else node.id if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            else ""
        )  # fmt: skip
        if name.strip("_") in NAMELESS and (str(path), name) not in SERIALISED:
            yield f"{at}: {name}: expected a name of what it holds"


if __name__ == "__main__":
    files = {file.resolve(): file for top in PRODUCT for file in sorted(Path(top).rglob("*.py"))}
    lines = [line for file in files.values() for line in complaints(file)]
    print(*lines, sep="\n", end="\n" if lines else "")
    sys.exit(bool(lines))
