"""What the modules of asrsim import, read from their source."""

import ast
from functools import cache

from support.paths import ROOT

PACKAGE = ROOT / "asrsim"
SOURCES = sorted(PACKAGE.rglob("*.py"))


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in SOURCES}


def imported(path, *, types):
    """Modules that a file imports, also inside functions. types: also those that it imports for type checkers only."""
    return tuple(name for name, for_types in _imports(path) if types or not for_types)


@cache
def _imports(path):
    """Pairs (imported module, whether only type checkers import it) of a file."""
    nodes = [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    checked = [node for node in nodes if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)]
    for_types = {id(child) for node in checked for child in ast.walk(node)}
    found = []
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in for_types) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, ast.unparse(node)
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.append((whole if whole in MODULES else str(node.module), id(node) in for_types))
    return found
