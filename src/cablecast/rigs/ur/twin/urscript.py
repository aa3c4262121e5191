"""Interpreter for the part of URScript that our own programs use.

It runs numbers, truth values, lists, functions, `if`, `while`, and the built-in functions that the
controller hands in. Built-in functions that take time, such as `servoj`, give their command to the
controller, which carries it out and then goes on with the program. Anything else is refused when
the program is loaded, as the real controller refuses a program that does not compile.

Source of the language: Universal Robots, "The URScript Programming Language".
"""

import ast
import dataclasses
import json
import operator
import re
from collections.abc import Callable, Generator, Mapping
from typing import Any

from cablecast.errors import InputError

PROGRAM_SIZE_MAX = 8_000_000
"""Longest program [character]."""
STEP_COUNT_MAX = 100_000
"""Most statements between two commands that take time; more is an endless loop."""

Command = tuple[str, tuple[Any, ...], dict[str, Any]]
"""Name of a function that takes time, its arguments, and its named arguments."""
Run = Generator[Command, None, Any]

_CALL = re.compile(r"(\w+)\((.*)\)$", re.DOTALL)
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


@dataclasses.dataclass
class _Statement:
    kind: str
    line: int
    name: str = ""
    value: ast.expr | None = None
    arguments: tuple[str, ...] = ()
    plain: list[Any] = dataclasses.field(default_factory=list)
    blocks: list[tuple[ast.expr | None, list["_Statement"]]] = dataclasses.field(
        default_factory=list
    )


class Program:
    """One program, `def name(): ... end`, ready to run.

    Args:
        text: Source of the program.

    Raises:
        ScriptError: It does not compile; names the line.
    """

    def __init__(self, text: str):
        if len(text) > PROGRAM_SIZE_MAX:
            raise ScriptError(f"the program has {len(text)} characters, more than allowed")
        lines = [
            (number, stripped)
            for number, line in enumerate(text.splitlines(), 1)
            if (stripped := line.split("#", 1)[0].strip())
        ]
        parser = _Parser(lines)
        statements = parser.block(())
        if len(statements) != 1 or statements[0].kind != "def":
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
            yield from _Machine(instant, timed).body(self._main.blocks[0][1], {})
        except _Return as returned:
            return returned.value


class _Parser:
    """Turns lines into statements."""

    def __init__(self, lines: list[tuple[int, str]]):
        self.lines = lines
        self.at = 0

    def block(self, ends: tuple[str, ...]) -> list[_Statement]:
        """Parse statements up to a line that ends the block, which is left to the caller."""
        statements = []
        while self.at < len(self.lines):
            number, line = self.lines[self.at]
            word = re.split(r"[\s:(]", line, maxsplit=1)[0]
            if word in ends:
                return statements
            self.at += 1
            statements.append(self._statement(number, line, word))
        if ends:
            raise ScriptError(f"the program ends before {' or '.join(ends)}")
        return statements

    def _statement(self, number: int, line: str, word: str) -> _Statement:
        if word == "def":
            match = re.fullmatch(r"def\s+(\w+)\(([\w\s,]*)\):", line)
            if not match:
                raise ScriptError(f"line {number}: {line[:60]!r} is no definition")
            names = tuple(part.strip() for part in match[2].split(",") if part.strip())
            body = self.block(("end",))
            self.at += 1
            return _Statement("def", number, match[1], arguments=names, blocks=[(None, body)])
        if word in ("if", "while"):
            return self._branch(number, line, word)
        if word == "return":
            rest = line[len("return") :].strip()
            return _Statement("return", number, value=_expression(rest or "None", number))
        match = re.fullmatch(r"(?:(global|local)\s+)?(\w+)\s*=(?!=)\s*(.+)", line)
        if match:
            kind = match[1] or "set"
            return _Statement(kind, number, match[2], value=_expression(match[3], number))
        match = _CALL.fullmatch(line)
        if not match:
            raise ScriptError(f"line {number}: {line[:60]!r} is no statement")
        try:
            # A path is thousands of calls with plain numbers, which JSON reads ten times as fast.
            return _Statement("plain call", number, match[1], plain=json.loads(f"[{match[2]}]"))
        except ValueError:
            return _Statement("call", number, value=_expression(line, number))

    def _branch(self, number: int, line: str, word: str) -> _Statement:
        if not line.endswith(":"):
            raise ScriptError(f"line {number}: {line[:60]!r} lacks its colon")
        statement = _Statement(word, number)
        condition = _expression(line[len(word) : -1], number)
        while True:
            body = self.block(("elif", "else", "end") if word == "if" else ("end",))
            statement.blocks.append((condition, body))
            number, line = self.lines[self.at]
            self.at += 1
            if line == "end":
                return statement
            condition = _expression(line[4:-1], number) if line.startswith("elif") else None


def _expression(text: str, number: int) -> ast.expr:
    """Parse an expression; URScript's are a part of Python's."""
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError):
        raise ScriptError(f"line {number}: {text[:60]!r} is no expression") from None


class _Return(Exception):  # noqa: N818 - it is no error
    def __init__(self, value: Any):
        self.value = value


class _Machine:
    """State of a running program."""

    def __init__(self, instant: Mapping[str, Callable[..., Any]], timed: set[str]):
        self.instant = instant
        self.timed = timed
        self.globals: dict[str, Any] = {"True": True, "False": False}
        self.functions: dict[str, _Statement] = {}
        self.steps = 0

    def body(self, statements: list[_Statement], scope: dict[str, Any]) -> Run:
        """Run statements one after another."""
        for statement in statements:
            self.steps += 1
            if self.steps > STEP_COUNT_MAX:
                raise ScriptError(f"line {statement.line}: an endless loop without a motion")
            try:
                yield from self._statement(statement, scope)
            except (TypeError, ValueError, ZeroDivisionError, IndexError, KeyError) as error:
                raise ScriptError(f"line {statement.line}: {error}") from None

    def _statement(self, statement: _Statement, scope: dict[str, Any]) -> Run:
        kind, value = statement.kind, statement.value
        if kind == "def":
            self.functions[statement.name] = statement
        elif kind == "if":
            for condition, block in statement.blocks:
                if condition is None or self._evaluate(condition, scope):
                    yield from self.body(block, scope)
                    break
        elif kind == "while":
            condition, block = statement.blocks[0]
            while condition is not None and self._evaluate(condition, scope):
                yield from self.body(block, scope)
        elif kind == "plain call":
            yield from self._invoke(statement.name, tuple(statement.plain), {})
        elif kind == "call" and isinstance(value, ast.Call):
            yield from self._call(value, scope)
        elif value is not None:
            result = self._evaluate(value, scope)
            if kind == "return":
                raise _Return(result)
            if kind == "local" or (kind == "set" and statement.name in scope):
                scope[statement.name] = result
            else:
                self.globals[statement.name] = result

    def _call(self, call: ast.Call, scope: dict[str, Any]) -> Run:
        """Run a call, and return its value."""
        name = call.func.id if isinstance(call.func, ast.Name) else ""
        values = tuple(self._evaluate(argument, scope) for argument in call.args)
        named = {str(k.arg): self._evaluate(k.value, scope) for k in call.keywords}
        return (yield from self._invoke(name, values, named))

    def _invoke(self, name: str, values: tuple[Any, ...], named: dict[str, Any]) -> Run:
        """Run a function, and return its value."""
        if name in self.functions:
            function = self.functions[name]
            if len(values) != len(function.arguments) or named:
                raise TypeError(f"{name} takes {len(function.arguments)} arguments")
            try:
                inner = dict(zip(function.arguments, values, strict=True))
                yield from self.body(function.blocks[0][1], inner)
            except _Return as returned:
                return returned.value
            return None
        if name in self.instant:
            return self.instant[name](*values, **named)
        if name in self.timed:
            self.steps = 0
            yield name, values, named
            return None
        raise KeyError(f"there is no function {name!r}")

    def _evaluate(self, node: ast.expr, scope: dict[str, Any]) -> Any:
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            if node.id in scope:
                return scope[node.id]
            if node.id in self.globals:
                return self.globals[node.id]
            raise KeyError(f"there is no name {node.id!r}")
        if isinstance(node, ast.List):
            return [self._evaluate(item, scope) for item in node.elts]
        if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
            return _OPERATORS[type(node.op)](self._evaluate(node.operand, scope))
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            left, right = self._evaluate(node.left, scope), self._evaluate(node.right, scope)
            return _OPERATORS[type(node.op)](left, right)
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
            left = self._evaluate(node.left, scope)
            return _OPERATORS[type(node.ops[0])](left, self._evaluate(node.comparators[0], scope))
        if isinstance(node, ast.BoolOp):
            values = (self._evaluate(value, scope) for value in node.values)
            return all(values) if isinstance(node.op, ast.And) else any(values)
        if isinstance(node, ast.Subscript):
            return self._evaluate(node.value, scope)[self._evaluate(node.slice, scope)]
        if isinstance(node, ast.Call):
            run = self._call(node, scope)
            try:
                name, *_ = next(run)
            except StopIteration as stop:
                return stop.value
            raise TypeError(f"{name} takes time and has no value")
        raise TypeError(f"a {type(node).__name__} is not understood")
