"""Translates one Python function of numbers and rows to the source of a Warp function.

Warp is stricter than Python: an expression cannot mix numbers of different types, a variable keeps its type, and a variable
that changes in a loop must be declared before as `int(...)` or `float(...)`. The types of all variables are therefore inferred
from the types of the arguments. The translation is repeated until these types no longer change.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
import types
from collections.abc import Callable, Sequence
from typing import Any

from asrsim.warping.values import (
    BOOL,
    FLOAT,
    INT,
    ORDER,
    Group,
    Row,
    TranslationError,
    Value,
    constant,
    group,
    joined,
    number_as,
)

UNARY = ("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "log2", "log10", "cbrt")
"""Functions of one number in `math` that have the same name in Warp."""
OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Lt: "<", ast.LtE: "<=",
    ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.And: "and", ast.Or: "or",
}  # fmt: skip
MOST_PASSES = 8
"""Number of translations of a function after which the types of its variables must no longer change."""
Call = Callable[["Translation", list[Value]], Value]
"""Function that translates a call. Its arguments are the translation of the calling function and the translated arguments."""


def source_of(function: Any) -> ast.FunctionDef:
    """Syntax tree of a function. Raises TranslationError if the source of the function cannot be read."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError) as error:
        raise TranslationError("its source code is not available") from error
    if len(tree.body) != 1 or not isinstance(tree.body[0], ast.FunctionDef):
        raise TranslationError("it is not a function that is defined by `def`")
    return tree.body[0]


class Translation:
    """Translation of one function for arguments of certain types."""

    def __init__(
        self, function: Any, name: str, kinds: Sequence[Any], call: Callable[[Any, Translation, list[Value]], Value]
    ) -> None:
        """name: name of the function in Warp; kinds: types of its arguments; call: function that translates the calls of other
        functions."""
        self._function, self._call = function, call
        self._tree = source_of(function)
        self._names: dict[str, Any] = {}
        """Type of each local variable."""
        self.returned: Any = None
        """Type of the function's result; None if the function returns nothing."""
        arguments = self._tree.args
        given = [*arguments.posonlyargs, *arguments.args]
        if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or len(given) != len(kinds):
            raise TranslationError(
                f"it must take {len(kinds)} arguments by position",
            )
        self._arguments = dict(zip((one.arg for one in given), kinds, strict=True))
        for _ in range(MOST_PASSES):
            before = dict(self._names), self.returned
            self._pass()
            if before == (self._names, self.returned):
                break
        else:
            raise TranslationError("the types of its variables cannot be determined")
        self.text = "\n".join(
            [f"def {name}({', '.join(self._signature)}):", *(f"    {line}" for line in self._lines or ["pass"])]
        )

    def _pass(self) -> None:
        self._lines: list[str] = []
        self._depth, self._count = 0, 0
        self._bound: dict[str, Value] = {}
        """Translation of each local variable."""
        self._signature: list[str] = []
        for name, kind in self._arguments.items():
            self._bound[name] = self._argument(name, kind)
            if kind in ORDER:
                self._names.setdefault(name, kind)
        self._block(self._tree.body)

    def _argument(self, name: str, kind: Any) -> Value:
        if isinstance(kind, Group):
            return group([self._argument(f"{name}_{i}", one) for i, one in enumerate(kind.kinds)])
        self._signature.append(f"{name}: {kind.annotation}")
        if isinstance(kind, Row):
            self._signature.append(f"{name}_at: int")
            return Value(kind, name, f"{name}_at")
        return Value(kind, name)

    # -- statements -------------------------------------------------------------------------------------------------

    def line(self, text: str) -> None:
        """Add a line to the source of the Warp function, indented as deep as the present block."""
        self._lines.append("    " * self._depth + text)

    def fresh(self) -> str:
        """Name for a new variable of the Warp function."""
        self._count += 1
        return f"t{self._count}_"

    def _block(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            kind = type(statement).__name__
            method = getattr(self, f"_do_{kind.lower()}", None)
            if method is None:
                raise self.refused(statement, f"has no translation ({kind})")
            try:
                method(statement)
            except TranslationError as error:
                if "line " in str(error):
                    raise
                raise self.refused(statement, str(error)) from error

    def refused(self, node: ast.AST, why: str) -> TranslationError:
        """Error with the reason `why`, which names the line of a syntax node in the Python source."""
        try:
            first = inspect.getsourcelines(self._function)[1]
        except OSError:
            first = 1
        where = f"{inspect.getsourcefile(self._function)}, line {first + getattr(node, 'lineno', 1) - 1}"
        return TranslationError(f"{where}: `{ast.unparse(node).splitlines()[0]}`: {why}")

    def _indented(self, body: Sequence[ast.stmt]) -> None:
        self._depth += 1
        count = len(self._lines)
        self._block(body)
        if len(self._lines) == count:
            self.line("pass")
        self._depth -= 1

    def _do_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        found = self.value(node.value)
        if found.text and isinstance(node.value, ast.Call):
            # Assign the result to a new name, since Warp does not accept a call whose result is not used.
            self.line(found.text if found.kind is None else f"{self.fresh()} = {found.text}")

    def _do_pass(self, node: ast.Pass) -> None:
        self.line("pass")

    def _do_break(self, node: ast.Break) -> None:
        self.line("break")

    def _do_continue(self, node: ast.Continue) -> None:
        self.line("continue")

    def _do_return(self, node: ast.Return) -> None:
        if node.value is None:
            self.line("return")
            return
        found = self.value(node.value)
        if isinstance(found.kind, Row):
            raise TranslationError("a function cannot return a row")
        self.returned = joined(self.returned, found.kind)
        self.line(f"return {', '.join(number_as(found, self.returned).arguments)}")

    def _do_assign(self, node: ast.Assign) -> None:
        found = self.value(node.value)
        if len(node.targets) > 1 or isinstance(node.targets[0], ast.Tuple):
            # Compute all values before the first one is stored, as in Python, since a value may contain a variable that is
            # assigned.
            found = self._stored(found, fresh=True)
        for target in node.targets:
            self._store(target, found)

    def _do_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            found = self.value(node.value)
            if ast.unparse(node.annotation) == "float":
                found = number_as(found, FLOAT)
            self._store(node.target, found)

    def _do_augassign(self, node: ast.AugAssign) -> None:
        there = self.value(ast.parse(ast.unparse(node.target), mode="eval").body)
        self._store(node.target, self._combined(node.op, there, self.value(node.value)))

    def _store(self, target: ast.expr, found: Value) -> None:
        if isinstance(target, ast.Tuple):
            items = self._items(found, len(target.elts))
            for one, value in zip(target.elts, items, strict=True):
                self._store(one, value)
        elif isinstance(target, ast.Name):
            self._bound[target.id] = self._stored(found, target.id)
        elif isinstance(target, ast.Subscript | ast.Attribute):
            place = self.value(target)
            if place.kind not in ORDER or not isinstance(self.value(target.value).kind, Row):
                raise TranslationError("only numbers of a row can be set")
            self.line(f"{place.text} = {number_as(found, place.kind).text}")
        else:
            raise TranslationError("this target has no translation")

    def _items(self, found: Value, count: int) -> list[Value]:
        """The `count` values of a tuple or row that is unpacked to as many names."""
        if isinstance(found.kind, Row):
            if found.kind.size not in (None, count):
                raise TranslationError(f"{found.kind.size} numbers cannot be unpacked to {count} names")
            return [found.part(str(i)) for i in range(count)]
        if len(found.items) != count:
            raise TranslationError(f"{len(found.items)} values cannot be unpacked to {count} names")
        return list(found.items)

    def _stored(self, found: Value, name: str = "", *, fresh: bool = False) -> Value:
        """Store a value in the variable `name`, and return this variable's translation. fresh: store it in a new variable."""
        if found.kind is None:
            raise TranslationError("a function without a result has no value")
        if isinstance(found.kind, Group):
            return group([self._stored(item, f"{name}_{i}", fresh=fresh) for i, item in enumerate(found.items)])
        if isinstance(found.kind, Row):
            if fresh:
                return found
            self.line(f"{name}_at = int({found.at})")
            return Value(found.kind, found.text, f"{name}_at")
        if found.kind not in ORDER:
            return found
        if fresh:
            if found.known is not None:
                return found
            name = self.fresh()
            kind = found.kind
        else:
            kind = self._names[name] = joined(self._names.get(name), found.kind)
        text = number_as(found, kind).text
        # Convert the value to its type. If a constant or another variable were assigned directly, Warp would assume that the
        # variable never changes.
        self.line(f"{name} = {text if kind == BOOL else f'{kind.name}({text})'}")
        return Value(kind, name)

    def _do_if(self, node: ast.If) -> None:
        self.line(f"if {self._condition(node.test)}:")
        self._indented(node.body)
        if node.orelse:
            self.line("else:")
            self._indented(node.orelse)

    def _do_while(self, node: ast.While) -> None:
        if node.orelse:
            raise TranslationError("`else` of a loop has no translation")
        before = len(self._lines)
        condition = self._condition(node.test)
        if len(self._lines) != before:
            raise TranslationError("the condition of `while` calls a function with several results")
        self.line(f"while {condition}:")
        self._indented(node.body)

    def _do_for(self, node: ast.For) -> None:
        if node.orelse:
            raise TranslationError("`else` of a loop has no translation")
        steps = node.iter
        if isinstance(steps, ast.Call) and isinstance(steps.func, ast.Name) and steps.func.id == "range":
            limits = ", ".join(number_as(self._stored(self.value(one), fresh=True), INT).text for one in steps.args)
            if not isinstance(node.target, ast.Name):
                raise TranslationError("the index of a loop must be a name")
            self._names[node.target.id] = INT
            self._bound[node.target.id] = Value(INT, node.target.id)
            self.line(f"for {node.target.id} in range({limits}):")
            self._indented(node.body)
            return
        found = self.value(steps)
        if not isinstance(found.kind, Group):
            raise TranslationError("loops run over `range` or over a tuple")
        # Repeat the body of the loop for each item of the tuple, since Warp has no loops over tuples.
        for item in found.items:
            self._store(node.target, item)
            self._block(node.body)

    # -- expressions ------------------------------------------------------------------------------------------------

    def _condition(self, node: ast.expr) -> str:
        return number_as(self.value(node), BOOL).text

    def value(self, node: ast.expr) -> Value:
        """Translation of an expression. Calls of functions with several results become lines of their own before it."""
        method = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if method is None:
            raise TranslationError(f"an expression of the type {type(node).__name__} has no translation")
        return method(node)  # type: ignore[no-any-return]

    def _of_constant(self, node: ast.Constant) -> Value:
        return constant(node.value)

    def call(self, function: Any, given: list[Value]) -> Value:
        """Translation of the call of a function with these arguments."""
        return self._call(function, self, given)

    def _of_name(self, node: ast.Name) -> Value:
        if node.id in self._bound:
            return self._bound[node.id]
        return self._outer(node.id)

    def _outer(self, name: str) -> Value:
        function = self._function
        enclosed = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
        if name in enclosed:
            return self._known(enclosed[name].cell_contents)
        if name in function.__globals__:
            return self._known(function.__globals__[name])
        if hasattr(builtins, name):
            return self._known(getattr(builtins, name))
        raise TranslationError(f"the name '{name}' is not known")

    @staticmethod
    def _known(found: Any) -> Value:
        # Keep a named tuple unchanged, since its numbers are accessed by their names.
        if callable(found) or isinstance(found, types.ModuleType) or hasattr(found, "_fields"):
            return Value(None, known=found)
        return constant(found)

    def _of_attribute(self, node: ast.Attribute) -> Value:
        owner = self.value(node.value)
        if isinstance(owner.kind, Row) and owner.kind.record is not None:
            return owner.field(node.attr)
        if owner.kind is not None or owner.known is None or not hasattr(owner.known, node.attr):
            raise TranslationError(f"'.{node.attr}' has no translation")
        return self._known(getattr(owner.known, node.attr))

    def _of_tuple(self, node: ast.Tuple) -> Value:
        return group(self._values(node.elts))

    _of_list = _of_tuple

    def _values(self, nodes: Sequence[ast.expr]) -> list[Value]:
        """Translations of expressions; an expression with a star gives one value for each item of its tuple."""
        found = []
        for node in nodes:
            if not isinstance(node, ast.Starred):
                found.append(self.value(node))
                continue
            whole = self.value(node.value)
            size = whole.kind.size if isinstance(whole.kind, Row) else len(whole.items)
            if size is None:
                raise TranslationError("the number of values is not known")
            found += self._items(whole, size)
        return found

    def _of_subscript(self, node: ast.Subscript) -> Value:
        owner = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            raise TranslationError("slices have no translation")
        index = self.value(node.slice)
        if isinstance(owner.kind, Group):
            if not isinstance(index.known, int):
                raise TranslationError("the index of a tuple must be a constant")
            return owner.items[index.known]
        if not isinstance(owner.kind, Row):
            raise TranslationError("only rows and tuples have items")
        if isinstance(index.known, int) and index.known < 0:
            if owner.kind.size is None:
                raise TranslationError("indices must not be negative")
            index = constant(owner.kind.size + index.known)
        return owner.part(number_as(index, INT).text)

    def _of_binop(self, node: ast.BinOp) -> Value:
        return self._combined(node.op, self.value(node.left), self.value(node.right))

    def _combined(self, operator: ast.operator, left: Value, right: Value) -> Value:
        if isinstance(operator, ast.Pow):
            return self._power(left, right)
        if type(operator) not in OPERATORS:
            raise TranslationError(f"the operator {type(operator).__name__} has no translation")
        kind = max(joined(left.kind, right.kind), INT, key=lambda one: ORDER.get(one, 9))
        if kind not in ORDER:
            raise TranslationError("operators take only numbers")
        kind = FLOAT if isinstance(operator, ast.Div) else kind
        if kind == FLOAT and isinstance(operator, ast.FloorDiv | ast.Mod):
            whole = f"wp.floor({number_as(left, FLOAT).text} / {number_as(right, FLOAT).text})"
            if isinstance(operator, ast.FloorDiv):
                return Value(FLOAT, whole)
            return Value(FLOAT, f"({number_as(left, FLOAT).text} - {whole} * {number_as(right, FLOAT).text})")
        return Value(kind, f"({number_as(left, kind).text} {OPERATORS[type(operator)]} {number_as(right, kind).text})")

    @staticmethod
    def _power(base: Value, power: Value) -> Value:
        if isinstance(power.known, int) and 2 <= power.known <= 4 and base.text.isidentifier():
            return Value(base.kind, f"({' * '.join([base.text] * power.known)})")
        return Value(FLOAT, f"wp.pow({number_as(base, FLOAT).text}, {number_as(power, FLOAT).text})")

    def _of_unaryop(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return Value(BOOL, f"(not {self._condition(node.operand)})")
        found = self.value(node.operand)
        if found.kind not in (INT, FLOAT) or isinstance(node.op, ast.Invert):
            raise TranslationError("signs apply only to numbers")
        if isinstance(node.op, ast.UAdd):
            return found
        if isinstance(found.known, int | float):
            return constant(-found.known)
        return Value(found.kind, f"(-{found.text})")

    def _of_compare(self, node: ast.Compare) -> Value:
        values = self._values([node.left, *node.comparators])
        parts = []
        for operator, left, right in zip(node.ops, values[:-1], values[1:], strict=True):
            if type(operator) not in OPERATORS:
                raise TranslationError(f"the comparison {type(operator).__name__} has no translation")
            kind = max(joined(left.kind, right.kind), INT, key=lambda one: ORDER.get(one, 9))
            parts.append(f"{number_as(left, kind).text} {OPERATORS[type(operator)]} {number_as(right, kind).text}")
        return Value(
            BOOL, f"({' and '.join(parts)})" if len(parts) == 1 else "(" + " and ".join(f"({one})" for one in parts) + ")"
        )

    def _of_boolop(self, node: ast.BoolOp) -> Value:
        parts = [self._condition(one) for one in node.values]
        return Value(BOOL, f"({f' {OPERATORS[type(node.op)]} '.join(parts)})")

    def _of_ifexp(self, node: ast.IfExp) -> Value:
        condition, first, second = self._condition(node.test), self.value(node.body), self.value(node.orelse)
        kind = joined(first.kind, second.kind)
        if isinstance(kind, Group):
            pairs = zip(number_as(first, kind).items, number_as(second, kind).items, strict=True)
            return group([Value(a.kind, f"wp.where({condition}, {a.text}, {b.text})") for a, b in pairs])
        if isinstance(kind, Row) and first.kind == second.kind and first.text == second.text:
            return Value(first.kind, first.text, f"wp.where({condition}, {first.at}, {second.at})")
        if kind not in ORDER:
            raise TranslationError("a conditional expression takes only numbers")
        return Value(kind, f"wp.where({condition}, {number_as(first, kind).text}, {number_as(second, kind).text})")

    def _of_call(self, node: ast.Call) -> Value:
        if node.keywords:
            raise TranslationError("arguments by keyword have no translation")
        function = self.value(node.func).known
        given = self._values(node.args)
        own = BUILT_IN.get(function) if isinstance(function, types.BuiltinFunctionType | type) else None
        found = own(self, given) if own else self._call(function, self, given)
        if isinstance(found.kind, Group) and found.text:
            names = [self.fresh() for _ in found.kind.kinds]
            self.line(f"{', '.join(names)} = {found.text}")
            return group([Value(kind, name) for kind, name in zip(found.kind.kinds, names, strict=True)])
        return found


# -- functions of Python and of math ---------------------------------------------------------------------------------------


def _real(text: str, count: int, kind: Any = FLOAT) -> Call:
    """Translates calls of a function of `count` real numbers to this text, in which {0} and {1} stand for the arguments. kind:
    type of the result.
    """

    def call(caller: Translation, given: list[Value]) -> Value:
        if len(given) != count:
            raise TranslationError(f"a call with {len(given)} arguments has no translation")
        return Value(kind, text.format(*(number_as(one, FLOAT).text for one in given)))

    return call


def _extreme(name: str) -> Call:
    def call(caller: Translation, given: list[Value]) -> Value:
        values = list(given[0].items) if len(given) == 1 else given
        kind, total = INT, values[0]
        for one in values:
            kind = max(joined(kind, one.kind), INT, key=ORDER.__getitem__)
        for one in values[1:]:
            total = Value(kind, f"wp.{name}({number_as(total, kind).text}, {number_as(one, kind).text})")
        return total

    return call


def _absolute(caller: Translation, given: list[Value]) -> Value:
    return Value(given[0].kind, f"wp.abs({given[0].text})")


def _power(caller: Translation, given: list[Value]) -> Value:
    return Value(FLOAT, f"wp.pow({number_as(given[0], FLOAT).text}, {number_as(given[1], FLOAT).text})")


def _as(kind: Any) -> Call:
    return lambda caller, given: number_as(given[0], kind)


def _range(caller: Translation, given: list[Value]) -> Value:
    raise TranslationError("`range` can only be used in `for`")


BUILT_IN: dict[Any, Call] = {
    **{getattr(math, name): _real(f"wp.{name}({{0}})", 1) for name in UNARY},
    math.atan2: _real("wp.atan2({0}, {1})", 2), math.hypot: _real("wp.sqrt({0} * {0} + {1} * {1})", 2),
    math.pow: _power, pow: _power, math.fabs: _real("wp.abs({0})", 1), abs: _absolute,
    math.copysign: _real("wp.where({1} < 0.0, -wp.abs({0}), wp.abs({0}))", 2),
    math.expm1: _real("(wp.exp({0}) - 1.0)", 1), math.log1p: _real("wp.log(1.0 + {0})", 1),
    math.floor: _real("int(wp.floor({0}))", 1, INT), math.ceil: _real("int(wp.ceil({0}))", 1, INT),
    math.isfinite: _real("wp.isfinite({0})", 1, BOOL), math.isnan: _real("wp.isnan({0})", 1, BOOL),
    min: _extreme("min"), max: _extreme("max"), float: _as(FLOAT), int: _as(INT), bool: _as(BOOL), range: _range,
}  # fmt: skip
"""Translation of the calls of each function of Python and of `math` that translated code may call."""
