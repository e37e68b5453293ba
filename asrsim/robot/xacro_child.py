"""Run as a script by `asrsim.confined.run`: expands one xacro file under restrictions.

The script reads a JSON request from stdin, and writes a JSON answer to stdout. It imports nothing of asrsim.

The file cannot reach an attribute of a Python object (attribute access is a guarded call that
knows xacro's name spaces, YAML tables and a few string methods), define functions, see `type` or `vars`, read files
outside the allowed folders, read environment variables, write files, or run forever.
"""

from __future__ import annotations

import ast
import io
import json
import sys
from pathlib import Path
from typing import Any
from xml.parsers import expat

_NODES = (
    ast.Expression, ast.Constant, ast.Name, ast.Load, ast.Store, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare,
    ast.IfExp, ast.Call, ast.keyword, ast.Starred, ast.Attribute, ast.Subscript, ast.Slice, ast.List, ast.Tuple, ast.Dict,
    ast.Set, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp, ast.comprehension, ast.operator, ast.unaryop,
    ast.boolop, ast.cmpop, ast.JoinedStr, ast.FormattedValue,
)  # fmt: skip
_STRING_METHODS = (
    "capitalize", "count", "endswith", "find", "index", "isdigit", "isnumeric", "join", "lower", "lstrip", "replace",
    "rstrip", "split", "splitlines", "startswith", "strip", "title", "upper", "zfill",
)  # fmt: skip
_TABLE_METHODS = ("get", "items", "keys", "values", "index", "count")
_GUARD = "asrsim_attribute"
_MAX_EXPRESSION = 10_000
"""Largest length of an expression in a xacro file, characters."""


class RefusedError(Exception):
    """The file uses something that a robot file may not use."""

    def __init__(self, message: str, *, code: str, hint: str | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.hint = hint


class _Guarding(ast.NodeTransformer):
    """Replaces each attribute access `a.b` by a guarded call."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        return ast.copy_location(ast.Call(ast.Name(_GUARD, ast.Load()), [node.value, ast.Constant(node.attr)], []), node)


def _attribute(owner: Any, name: str) -> Any:
    import xacro

    if not name.startswith("_"):
        if isinstance(owner, xacro.NameSpace):
            return owner[name]
        if isinstance(owner, xacro.YamlDictWrapper) and name in owner:
            return owner[name]
        if (isinstance(owner, str) and name in _STRING_METHODS) or (isinstance(owner, (dict, list)) and name in _TABLE_METHODS):
            return getattr(owner, name)
    raise RefusedError(f"attribute '{name}' may not be used in an expression", code="xacro-refused")


def _checked_eval(expression: str, table: Any, _local: Any = None) -> Any:
    """Value of an expression; replaces xacro's `safe_eval`."""
    if len(expression) > _MAX_EXPRESSION:
        raise RefusedError("an expression is too long", code="xacro-refused")
    tree = ast.parse(expression.strip(), "<expression>", "eval")
    for node in ast.walk(tree):
        if not isinstance(node, _NODES):
            raise RefusedError(f"'{expression.strip()[:80]}' uses Python that is not allowed", code="xacro-refused")
        if isinstance(node, ast.Name) and (node.id.startswith("__") or node.id == _GUARD):
            raise RefusedError(f"the name '{node.id}' may not be used in an expression", code="xacro-refused")
    code = compile(ast.fix_missing_locations(_Guarding().visit(tree)), "<expression>", "eval")
    # Pass xacro's symbol table as the global name space, so that comprehensions see its names.
    table.update({"__builtins__": {}, _GUARD: _attribute})
    return eval(code, table)


def _refuse_entities(text: str, file: str) -> None:
    parser = expat.ParserCreate()

    def document_type(_name: str, _system: str | None, _public: str | None, has_internal_subset: int) -> None:
        if has_internal_subset:
            raise RefusedError(f"{file} declares entities or a document type", code="xml-declarations")

    parser.StartDoctypeDeclHandler = document_type
    parser.Parse(text, True)


class _Guards:
    """Replacements for xacro's parsing, YAML loading, packages, environment and evaluation of `$(eval ...)`."""

    def __init__(self, request: dict[str, Any]) -> None:
        self._request = request

    def _read(self, filename: str) -> str:
        path = Path(filename).resolve()
        if not any(path.is_relative_to(root) for root in self._request["roots"]):
            raise RefusedError(
                f"{filename} lies outside the file's folder and the known packages",
                code="path-outside",
                hint="Name the package's folder if you trust it",
            )
        if not path.is_file():
            raise RefusedError(f"{filename} does not exist", code="missing-file")
        with path.open("rb") as stream:
            data = stream.read(self._request["max_bytes"] + 1)
        if len(data) > self._request["max_bytes"]:
            raise RefusedError(f"{filename} is too large", code="file-too-large")
        return data.decode("utf-8-sig")

    def parse(self, _given: Any, filename: str | None = None) -> Any:
        import xml.dom.minidom

        text = self._read(filename or "")
        try:
            _refuse_entities(text, filename or "")
            return xml.dom.minidom.parseString(text.encode())
        except expat.ExpatError as error:
            raise RefusedError(f"{filename}:{error.lineno}: not well-formed XML", code="malformed-xml") from error

    def load_yaml(self, filename: str) -> Any:
        import xacro
        import yaml

        for unit in xacro.ConstructUnits:
            yaml.SafeLoader.add_constructor(unit.value.tag, unit.constructor)
        full = xacro.abs_filename_spec(filename)
        text = self._read(full)
        xacro.filestack.append(full)
        try:
            return xacro.YamlListWrapper.wrap(yaml.safe_load(text))
        finally:
            xacro.filestack.pop()

    def find(self, name: str) -> str:
        if name in self._request["packages"]:
            return str(self._request["packages"][name])
        if name and "/" not in name and name not in (".", ".."):
            for root in map(Path, self._request["searched"]):
                candidates = (
                    [root, root / name, root / "share" / name] if root.name == name else [root / name, root / "share" / name]
                )
                for candidate in candidates:
                    if candidate.is_dir():
                        return str(candidate)
        raise RefusedError(
            f"package '{name}' is not known",
            code="unknown-package",
            hint=f"Give its folder: --package {name}=FOLDER, or packages in the scenario",
        )

    def environment(self, name: str) -> str:
        raise RefusedError(
            f"a robot file must not read the environment variable {name}", code="xacro-refused", hint="Use a xacro argument"
        )

    def evaluate(self, expression: str, context: dict[str, Any]) -> str:
        import xacro
        import xacro.substitution_args as substitution

        names = {
            key: value
            for key, value in xacro.create_global_symbols().items()
            if key not in ("load_yaml", "abs_filename", "dotify")
        }
        names.update(
            {key: substitution.convert_value(value, "auto") for key, value in context.get("arg", {}).items()},
            find=self.find,
            env=self.environment,
            optenv=lambda _name, default="": default,
            true=True,
            false=False,
            arg=lambda name: substitution.convert_value(context["arg"][name], "auto"),
        )
        return str(_checked_eval(expression, names))


def _restrict(request: dict[str, Any]) -> None:
    """Replace xacro's functions by the guarded functions."""
    import xacro
    import xacro.substitution_args as substitution

    guards = _Guards(request)
    xacro.safe_eval = _checked_eval
    xacro.parse = guards.parse
    xacro.load_yaml = guards.load_yaml
    substitution._eval_find = guards.find
    substitution._eval_env = guards.environment
    substitution._eval_optenv = lambda _name, default="": default
    substitution._eval = guards.evaluate
    # Xacro's symbol tables still contain the original functions. Create the tables again, and remove the unsafe names.
    symbols = xacro.create_global_symbols()
    for name in ("type", "vars", "hash", "repr"):
        symbols["python"].pop(name, None)
    xacro._global_symbols = symbols


def _expand(request: dict[str, Any]) -> str:
    import xacro

    document = xacro.process_file(request["path"], mappings=dict(request["arguments"]), verbosity=1)
    text: str = document.toprettyxml(indent="  ")
    if len(text) > request["max_bytes"]:
        raise RefusedError("the expanded robot is too large", code="file-too-large")
    return text


def _cause(error: BaseException) -> BaseException:
    """RefusedError that caused the exception; the exception itself if there is no such cause."""
    inner: BaseException | None = error
    while inner is not None:
        if isinstance(inner, RefusedError):
            return inner
        inner = getattr(inner, "exc", None) or inner.__cause__
    return error


def main() -> None:
    """Read one request from stdin, and write its answer to stdout."""
    request = json.loads(sys.stdin.buffer.read())
    answer: dict[str, Any]
    sys.stderr = io.StringIO()
    try:
        _restrict(request)
        answer = {"text": _expand(request)}
    except RecursionError:
        answer = {"error": "macros or properties call themselves endlessly", "code": "xacro-failed"}
    except MemoryError:
        answer = {"error": "needs too much memory", "code": "xacro-failed"}
    except Exception as error:
        cause = _cause(error)
        text = " ".join(str(cause).split()) or type(cause).__name__
        if cause is not error and "evaluating expression" in str(error):
            text += " (" + " ".join(str(getattr(error, "suffix", "") or "").split()) + ")"
        answer = {"error": text, "code": getattr(cause, "code", "xacro-failed"), "hint": getattr(cause, "hint", None)}
    try:
        import xacro

        stack = xacro.filestack or []
        if "error" in answer and stack and stack[-1] != request["path"]:
            answer["file"] = stack[-1]
    except Exception as error:
        answer.setdefault("error", f"xacro is not installed: {error}")
    lines = [line.removeprefix("warning: ") for line in sys.stderr.getvalue().splitlines() if line.startswith("warning: ")]
    answer["warnings"] = list(dict.fromkeys(lines))[:50]
    sys.stdout.write(json.dumps(answer))


if __name__ == "__main__":
    main()
