"""Interpreter for the part of URScript that our own programs use.

It runs numbers, truth values, lists of numbers, functions without a value, `if`, `while`, `halt`,
and the built-in functions that the controller hands in. Built-in functions that take time, such as
`servoj`, give their command to the controller, which carries it out and then goes on with the
program. Anything else is refused when the program is loaded, as the real controller refuses a
program that does not compile.

URScript's expressions are a part of Python's, so a program is rewritten in Python's grammar, line
by line, and its syntax tree is walked. Nothing of it ever runs as Python. Where versions of the
language differ, or its manual is silent, programs are refused: lists keep the length that they are
written with (others came with PolyScope 5.15) and take no arithmetic, whole numbers are not divided
by whole numbers, and little is done between two commands that take time.

Sources: Universal Robots, "The URScript Programming Language"; the maker's own spline program,
github.com/UniversalRobots/Universal_Robots_Client_Library, resources/external_control.urscript; on
lists forum.universal-robots.com/t/request-for-comments-variable-length-lists/30144; on time without
a command github.com/ros-industrial/universal_robot/issues/330.
"""

import ast
import operator
import re
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any

from cablecast.errors import InputError

PROGRAM_SIZE_MAX = 100_000
"""Longest program that a controller takes, if nothing else is said [byte]."""
STEP_COUNT_MAX = 1_000
"""Most statements between two commands that take time; more is an endless loop."""

Command = tuple[str, tuple[Any, ...], dict[str, Any]]
"""Name of a function that takes time, its arguments, and its named arguments."""
Run = Generator[Command, None, Any]

_DEFINITION = re.compile(r"def\s+\w+\([\w\s,]*\)\s*:")
_SCOPED = re.compile(r"(global|local)\s+(\w+)\s*=(?!=)")
_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class ScriptError(InputError):
    """A program that does not compile, or stops with an error."""


class Program:
    """One program, `def name(): ... end`, ready to run.

    Args:
        text: Source of the program.

    Raises:
        ScriptError: It does not compile; names the line.
    """

    def __init__(self, text: str):
        lines = [line.split("#", 1)[0].strip() for line in text.splitlines()]
        source = _as_python(lines)
        try:
            statements = ast.parse(source).body
        except SyntaxError as error:
            raise _no_statement(lines, error.lineno or 1) from None
        except (ValueError, RecursionError, MemoryError):
            raise ScriptError("the program is no URScript") from None
        _check_statements(statements, lines)
        if len(statements) != 1 or not isinstance(statements[0], ast.FunctionDef):
            raise ScriptError("a program is one definition: def name(): ... end")
        self._main = statements[0]

    @property
    def name(self) -> str:
        """Name of the program."""
        return self._main.name

    def run(self, instant: Mapping[str, Callable[..., Any]], timed: set[str]) -> Run:
        """Run the program, and yield each command that takes time.

        Args:
            instant: Built-in functions that return at once.
            timed: Names of built-in functions that take time.

        Raises:
            ScriptError: A name is unknown, or a value of the wrong kind.
        """
        try:
            yield from _Machine(instant, timed).body(self._main.body, {})
        except _Halt:
            return


def _as_python(lines: Sequence[str]) -> str:
    """Return a program in Python's grammar, line by line the same."""
    depth, written = 0, []
    for number, line in enumerate(lines, 1):
        word = re.split(r"[\s:(]", line, maxsplit=1)[0]
        here = depth - (word in ("elif", "else"))
        if word == "def" and not _DEFINITION.fullmatch(line):
            raise ScriptError(f"line {number}: {line[:60]!r} is no definition")
        if word in ("def", "if", "while"):
            depth += 1
        elif word == "end":
            # A block may be empty.
            line, depth = "pass", depth - 1
        if here < 0 or depth < 0:
            raise _no_statement(lines, number)
        written.append(" " * here + _SCOPED.sub(r"\2: '\1' =", line))
    if depth:
        raise ScriptError("the program ends before end")
    return "\n".join(written)


def _no_statement(lines: Sequence[str], number: int) -> ScriptError:
    return ScriptError(f"line {number}: {lines[number - 1][:60]!r} is no statement")


def _check_statements(statements: Sequence[ast.stmt], lines: Sequence[str]) -> None:
    """Refuse statements that Python has and URScript has not."""
    for statement in statements:
        match statement:
            case ast.FunctionDef(body=body) | ast.While(body=body, orelse=[]):
                _check_statements(body, lines)
            case ast.If(body=body, orelse=otherwise):
                _check_statements([*body, *otherwise], lines)
            case (
                ast.Pass()
                | ast.Expr(value=ast.Call() | ast.Name(id="halt"))
                | ast.Assign(targets=[ast.Name()])
                | ast.AnnAssign(target=ast.Name(), annotation=ast.Constant("global" | "local"))
            ):
                pass
            case _:
                raise _no_statement(lines, statement.lineno)


class _Halt(Exception):  # noqa: N818 - it is no error
    """End of the program."""


class _Machine:
    """State of a running program."""

    def __init__(self, instant: Mapping[str, Callable[..., Any]], timed: set[str]):
        self.instant = instant
        self.timed = timed
        self.globals: dict[str, Any] = {}
        self.functions: dict[str, ast.FunctionDef] = {}
        self.steps = 0

    def body(self, statements: Sequence[ast.stmt], scope: dict[str, Any]) -> Run:
        """Run statements one after another."""
        for statement in statements:
            self.steps += 1
            if self.steps > STEP_COUNT_MAX:
                raise ScriptError(f"line {statement.lineno}: an endless loop without a motion")
            try:
                yield from self._statement(statement, scope)
            except (TypeError, ValueError, ZeroDivisionError, IndexError, KeyError) as error:
                raise ScriptError(f"line {statement.lineno}: {error}") from None

    def _statement(self, statement: ast.stmt, scope: dict[str, Any]) -> Run:
        match statement:
            case ast.FunctionDef(name=name):
                self.functions[name] = statement
            case ast.If(test=test, body=body, orelse=otherwise):
                yield from self.body(body if self._evaluate(test, scope) else otherwise, scope)
            case ast.While(test=test, body=body):
                while self._evaluate(test, scope):
                    yield from self.body(body, scope)
            case ast.Expr(value=ast.Call() as call):
                yield from self._call(call, scope)
            case ast.Expr():
                raise _Halt
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                inner = name in scope
                (scope if inner else self.globals)[name] = self._evaluate(value, scope)
            case ast.AnnAssign(
                target=ast.Name(id=name), annotation=ast.Constant(kind), value=ast.expr() as value
            ):
                (scope if kind == "local" else self.globals)[name] = self._evaluate(value, scope)

    def _call(self, call: ast.Call, scope: dict[str, Any]) -> Run:
        """Run a function, and return its value."""
        name = call.func.id if isinstance(call.func, ast.Name) else ""
        values = tuple(self._evaluate(argument, scope) for argument in call.args)
        named = {str(k.arg): self._evaluate(k.value, scope) for k in call.keywords}
        if name in self.functions:
            function = self.functions[name]
            names = [argument.arg for argument in function.args.args]
            if len(values) != len(names) or named:
                raise TypeError(f"{name} takes {len(names)} arguments")
            yield from self.body(function.body, dict(zip(names, values, strict=True)))
            return None
        if name in self.instant:
            return self.instant[name](*values, **named)
        if name in self.timed:
            self.steps = 0
            yield name, values, named
            return None
        raise KeyError(f"there is no function {name!r}")

    def _evaluate(self, node: ast.expr, scope: dict[str, Any]) -> Any:
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                for names in (scope, self.globals):
                    if name in names:
                        return names[name]
                raise KeyError(f"there is no name {name!r}")
            case ast.List(elts=items):
                return [_number(self._evaluate(item, scope)) for item in items]
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](self._evaluate(operand, scope))
            case (
                ast.BinOp(left=left, op=op, right=right)
                | ast.Compare(left=left, ops=[op], comparators=[right])
            ) if type(op) in _OPERATORS:
                one, other = self._evaluate(left, scope), self._evaluate(right, scope)
                if isinstance(op, ast.Div) and isinstance(one, int) and isinstance(other, int):
                    raise TypeError("a whole number divided by a whole number")
                return _OPERATORS[type(op)](_number(one), _number(other))
            case ast.BoolOp(op=op, values=parts):
                values = (self._evaluate(part, scope) for part in parts)
                return all(values) if isinstance(op, ast.And) else any(values)
            case ast.Subscript(value=value, slice=index):
                values, at = self._evaluate(value, scope), self._evaluate(index, scope)
                if not isinstance(at, int) or not 0 <= at < len(values):
                    raise IndexError(f"index {at} of a list of {len(values)}")
                return values[at]
            case ast.Call():
                run = self._call(node, scope)
                try:
                    name, *_ = next(run)
                except StopIteration as stop:
                    return stop.value
                raise TypeError(f"{name} takes time and has no value")
        raise TypeError(f"a {type(node).__name__} is not understood")


def _number(value: Any) -> Any:
    """Return a number or truth value; no operator and no list takes anything else."""
    if not isinstance(value, (int, float)):
        raise TypeError(f"a {type(value).__name__} stands where a number belongs")
    return value
