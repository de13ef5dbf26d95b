"""A compiler of URScript: a recursive-descent parser that builds Python's syntax tree.

A function that may take time becomes a generator, in which ``yield`` is the end of a control cycle.
Lines of the tree are lines of the script, so a traceback shows where a program failed.  Lists and
poses are immutable: ``x[0] = 1`` gives ``x`` a new list, so assignment copies.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import CodeType
from typing import Any, cast

from emulated_ur.urscript.lexer import ScriptError, Token, tokens

FILE = "<urscript>"

_Builder = Callable[[ast.expr, ast.expr], ast.expr]


def _joined(kind: type[ast.boolop]) -> _Builder:
    return lambda left, right: ast.BoolOp(kind(), [left, right])


def _compared(kind: type[ast.cmpop]) -> _Builder:
    return lambda left, right: ast.Compare(left, [kind()], [right])


def _computed(kind: type[ast.operator]) -> _Builder:
    return lambda left, right: ast.BinOp(left, kind(), right)


_LEVELS: tuple[dict[str, _Builder], ...] = (
    {"or": _joined(ast.Or), "xor": _compared(ast.NotEq)},
    {"and": _joined(ast.And)},
    {"==": _compared(ast.Eq), "!=": _compared(ast.NotEq), "<": _compared(ast.Lt),
     "<=": _compared(ast.LtE), ">": _compared(ast.Gt), ">=": _compared(ast.GtE)},
    {"+": _computed(ast.Add), "-": _computed(ast.Sub)},
    {"*": _computed(ast.Mult), "/": _computed(ast.Div), "%": _computed(ast.Mod)},
)  # fmt: skip
"""Operators from the weakest to the strongest binding; ``not`` comes before a comparison."""

_NOT = 2


@dataclass(frozen=True)
class Script:
    """A compiled program.

    Attributes:
        name: after ``def`` or ``sec``; empty for a single line.
        is_secondary: whether it is a ``sec`` program, which runs in parallel with the main one.
        code: defines its functions, and ``main``.
        defines: its variables and functions, and whether those take time.
    """

    name: str
    is_secondary: bool
    code: CodeType
    defines: Mapping[str, bool]


@dataclass
class _Function:
    """A function, a thread or the program itself, with the scope of its names."""

    name: str
    parent: _Function | None
    is_thread: bool = False
    parameters: list[str] = field(default_factory=list)
    locals: set[str] = field(default_factory=set)
    assigned: set[str] = field(default_factory=set)
    reads: list[tuple[str, Token]] = field(default_factory=list)
    calls: list[tuple[ast.Call, str, Token]] = field(default_factory=list)
    inner: list[_Function] = field(default_factory=list)
    takes_time: bool = False
    node: ast.FunctionDef = field(init=False)

    def owner(self, name: str) -> _Function | None:
        """Return the function that owns the variable *name* here."""
        if name in self.parameters or name in self.locals:
            return self
        found = self.parent.owner(name) if self.parent else None
        return found or (self if name in self.assigned else None)

    def function(self, name: str) -> _Function | None:
        """Return the script's own function of that name that can be called here."""
        found = next((one for one in self.inner if one.name == name), None)
        return found or (self.parent.function(name) if self.parent else None)

    def all(self) -> Iterator[_Function]:
        """Yield this function and those inside it."""
        yield self
        for one in self.inner:
            yield from one.all()


def compile_script(
    text: str,
    functions: Mapping[str, Callable[..., Any]],
    known: Mapping[str, bool] | None = None,
) -> Script:
    """Compile one program: ``def .. end``, ``sec .. end``, or statements on a line.

    Args:
        text: the program.
        functions: the controller's functions; those that take time are generators.
        known: definitions of the program to which these statements are added; see
            :attr:`Script.defines`.

    Raises:
        ScriptError: it does not compile; the text begins like the controller's.
    """
    try:
        return _Compiler(text, functions, known or {}).program(is_whole=known is None)
    except (RecursionError, MemoryError) as error:
        raise ScriptError("syntax_error_on_line:1: too many brackets or blocks", 1, 1) from error
    except SyntaxError as error:  # a break outside a loop, a parameter that is there twice
        line = error.lineno or 1
        raise ScriptError(f"syntax_error_on_line:{line}: {error.msg}", line) from error


@functools.cache
def _signature(function: Callable[..., Any]) -> inspect.Signature:
    return inspect.signature(function)


class _Compiler:
    def __init__(
        self, text: str, functions: Mapping[str, Callable[..., Any]], known: Mapping[str, bool]
    ) -> None:
        self._known = known
        self._tokens = list(tokens(text))
        self._lines = text.split("\n")
        self._at = 0
        self._functions = functions
        self._here = _Function("", None)

    # Tokens.

    @property
    def _next(self) -> Token:
        return self._tokens[self._at]

    def _take(self) -> Token:
        token = self._tokens[self._at]
        if token.kind != "end":
            self._at += 1
        return token

    def _skip_lines(self) -> None:
        while self._next.kind == "newline":
            self._at += 1

    def _is(self, *texts: str) -> bool:
        return self._next.kind in ("sign", "keyword") and self._next.text in texts

    def _accept(self, text: str) -> bool:
        if self._is(text):
            self._at += 1
            return True
        return False

    def _expect(self, text: str) -> Token:
        if not self._is(text):
            raise self._wrong(f"expected {text!r}")
        return self._take()

    def _name(self) -> Token:
        if self._next.kind != "name":
            raise self._wrong("expected a name")
        return self._take()

    def _wrong(self, why: str) -> ScriptError:
        token = self._next
        source = self._lines[token.line - 1].strip() if token.line <= len(self._lines) else ""
        return ScriptError(
            f"syntax_error_on_line:{token.line}:{source}: {why}", token.line, token.column
        )

    # Programs and functions.

    def program(self, *, is_whole: bool) -> Script:
        """Return the compiled program."""
        self._skip_lines()
        kind = self._next.text if is_whole and self._is("def", "sec") else ""
        name = ""
        if kind:
            self._take()
            name = self._name().text
            for word in "():":
                self._expect(word)
        first = self._next
        body = self._block("end") if kind else self._block("")
        if kind:
            self._expect("end")
        self._skip_lines()
        if self._next.kind != "end":
            raise self._wrong("expected the end of the program")
        self._here.node = self._definition("main", body, first)
        self._resolve()
        everything = [one.node for one in self._here.inner] + [self._here.node]
        module = ast.fix_missing_locations(ast.Module(list(everything), []))
        defines = {f"v_{name}": False for name in self._here.assigned}
        defines |= {f"f_{one.name}": one.takes_time for one in self._here.inner}
        return Script(name, kind == "sec", compile(module, FILE, "exec"), defines)

    def _function(self) -> None:
        is_thread = self._take().text == "thread"
        name = self._name()
        outer, self._here = self._here, _Function(name.text, self._here, is_thread)
        outer.inner.append(self._here)
        self._expect("(")
        defaults: list[ast.expr] = []
        while not self._accept(")"):
            self._here.parameters.append(self._name().text)
            if self._accept("="):
                defaults.append(self._expression())
            if not self._is(")"):
                self._expect(",")
        self._expect(":")
        node = self._definition(f"f_{name.text}", self._block("end"), name)
        self._expect("end")
        node.args.args = [ast.arg(f"v_{one}") for one in self._here.parameters]
        node.args.defaults = defaults
        self._here.node, self._here = node, outer

    def _definition(self, name: str, body: list[ast.stmt], token: Token) -> ast.FunctionDef:
        node = cast("ast.FunctionDef", ast.parse(f"def {name}(): pass").body[0])
        node.body = body or node.body
        node.lineno = node.end_lineno = token.line
        return node

    def _resolve(self) -> None:
        """Resolve the scope of every name, and find which functions take time.

        Raises:
            ScriptError: an unknown name, or wrong arguments of a function.
        """
        everything = list(self._here.all())
        for one in everything:
            for name, token in one.reads:
                if one.owner(name) is None and f"v_{name}" not in self._known:
                    raise self._not_found(name, token)
            for _, name, token in one.calls:
                if not self._is_own(one, name) and name not in self._functions:
                    raise self._not_found(name, token)
            one.takes_time |= one.is_thread or one.parent is None
        is_settled = False
        while not is_settled:
            is_settled = True
            for one in everything:
                if not one.takes_time and any(self._lasts(one, name) for _, name, _ in one.calls):
                    one.takes_time, is_settled = True, False
        for one in everything:
            self._finish(one)

    def _not_found(self, name: str, token: Token) -> ScriptError:
        return ScriptError(f"compile_error_name_not_found:{name}:", token.line, token.column)

    def _lasts(self, caller: _Function, name: str) -> bool:
        if own := caller.function(name):
            return own.takes_time
        if self._is_own(caller, name):
            return self._known[f"f_{name}"]
        return inspect.isgeneratorfunction(self._functions[name])

    def _is_own(self, caller: _Function, name: str) -> bool:
        return caller.function(name) is not None or f"f_{name}" in self._known

    def _finish(self, one: _Function) -> None:
        for call, name, token in one.calls:
            if self._is_own(one, name):
                for keyword in call.keywords:
                    keyword.arg = f"v_{keyword.arg}"
                call.func = ast.Name(f"f_{name}", ast.Load())
            else:
                self._check_arguments(call, name, token)
        lasting = {id(call) for call, name, _ in one.calls if self._lasts(one, name)}
        _Waits(lasting).visit(one.node)
        names = one.assigned - one.locals - set(one.parameters)
        owners = {name: one.owner(name) for name in sorted(names)}
        shared = [f"v_{name}" for name, owner in owners.items() if owner and not owner.parent]
        outer = [
            f"v_{name}" for name, owner in owners.items() if owner and owner.parent and owner != one
        ]
        before: list[ast.stmt] = [ast.Global(shared)] if shared else []
        before += [ast.Nonlocal(outer)] if outer else []
        if one.parent:  # those of the program are the module's
            before += [inner.node for inner in one.inner]
        if one.takes_time:
            before.append(ast.If(ast.Constant(False), [ast.Expr(ast.Yield())], []))
        one.node.body[:0] = before

    def _check_arguments(self, call: ast.Call, name: str, token: Token) -> None:
        given = {one.arg or "": None for one in call.keywords}
        try:
            function = self._functions[name]
            own = (None,) if inspect.ismethod(function) else ()
            whole = _signature(getattr(function, "__func__", function))
            whole.bind(*own, *call.args, **given)
        except TypeError as error:
            raise ScriptError(
                f"compile_error_arguments:{name}: {error}", token.line, token.column
            ) from error
        except ValueError:
            pass  # one of Python's own, which says no more than that it was called wrongly

    # Statements.

    def _block(self, *ends: str) -> list[ast.stmt]:
        """Return statements up to a word that ends them, which is not consumed."""
        body: list[ast.stmt] = []
        while True:
            self._skip_lines()
            if self._is(*ends) or (self._next.kind == "end" and not any(ends)):
                return body
            token = self._next
            if token.kind == "end":
                raise self._wrong(f"expected {' or '.join(ends)!r}")
            if self._is("def", "thread"):
                self._function()
            else:
                body.append(self._statement())
                body[-1].lineno = body[-1].end_lineno = token.line

    def _statement(self) -> ast.stmt:
        token = self._next
        if token.kind != "keyword":
            return self._assignment_or_call()
        word = self._take().text
        if word == "if":
            return self._if()
        if word == "while":
            return self._while()
        if word in ("global", "local"):
            return self._declaration(word)
        if word == "return":
            has_value = self._next.kind not in ("newline", "end") and not self._is("end")
            return ast.Return(self._expression() if has_value else None)
        if word in ("break", "continue", "pass"):
            return {"break": ast.Break, "continue": ast.Continue, "pass": ast.Pass}[word]()
        if word in ("kill", "join"):
            thread = self._expression()
            if word == "kill":
                return ast.Expr(_helper("kill", thread))
            self._here.takes_time = True
            return ast.Expr(ast.YieldFrom(_helper("join", thread)))
        if word in ("halt", "enter_critical", "exit_critical"):
            if self._accept("("):
                self._expect(")")
            return ast.Expr(_helper("halt")) if word == "halt" else ast.Pass()
        self._at -= 1
        if word in ("run", "not", "True", "False"):
            return ast.Expr(self._expression())
        why = (
            "switch is not emulated: use if and elif"
            if word == "switch"
            else "expected a statement"
        )
        raise self._wrong(why)

    def _if(self) -> ast.stmt:
        test = self._expression()
        self._expect(":")
        body = self._block("elif", "else", "end") or [ast.Pass()]
        otherwise: list[ast.stmt] = []
        line = self._next.line
        if self._accept("elif"):
            otherwise = [self._if()]
            otherwise[0].lineno = otherwise[0].end_lineno = line
        elif self._accept("else"):
            self._expect(":")
            otherwise = self._block("end")
            self._expect("end")
        else:
            self._expect("end")
        return ast.If(test, body, otherwise)

    def _while(self) -> ast.stmt:
        test = self._expression()
        self._expect(":")
        body = self._block("end")
        self._expect("end")
        # A loop that never waits is interrupted, so that other threads run.
        self._here.takes_time = True
        pause = ast.If(_helper("tired"), [ast.Expr(ast.Yield())], [])
        return ast.While(test, [pause, *body], [])

    def _declaration(self, word: str) -> ast.stmt:
        name = self._name()
        program = self._here
        while program.parent:
            program = program.parent
        if word == "local" and self._here.parent:
            self._here.locals.add(name.text)
        elif word == "global":
            program.assigned.add(name.text)
        self._here.assigned.add(name.text)
        if not self._accept("="):
            return ast.Pass()
        return ast.Assign([_variable(name.text, ast.Store())], self._expression())

    def _assignment_or_call(self) -> ast.stmt:
        target = self._postfix()
        if not self._accept("="):
            if not isinstance(target, (ast.Call, ast.YieldFrom)):
                raise self._wrong("expected a call or an assignment")
            return ast.Expr(target)
        value = self._expression()
        while isinstance(target, ast.Subscript):
            value = _helper("replaced", target.value, target.slice, value)
            target = target.value
        if not isinstance(target, ast.Name):
            self._at = max(0, self._at - 1)
            raise self._wrong("expected a variable to assign to")
        self._here.assigned.add(target.id.removeprefix("v_"))
        return ast.Assign([ast.Name(target.id, ast.Store())], value)

    # Expressions.

    def _expression(self, level: int = 0) -> ast.expr:
        if level == len(_LEVELS):
            return self._unary()
        if level == 0:
            self._skip_lines()
        if level == _NOT and self._accept("not"):
            return ast.UnaryOp(ast.Not(), self._expression(level))
        left = self._expression(level + 1)
        while self._is(*_LEVELS[level]):
            build = _LEVELS[level][self._take().text]
            self._skip_lines()
            left = build(left, self._expression(level + 1))
        return left

    def _unary(self) -> ast.expr:
        if self._is("-", "+"):
            sign = ast.USub() if self._take().text == "-" else ast.UAdd()
            return ast.UnaryOp(sign, self._unary())
        return self._postfix()

    def _postfix(self) -> ast.expr:
        node = self._atom()
        while self._accept("["):
            places = self._items("]")
            if not 1 <= len(places) <= 2:
                raise self._wrong("expected an index, or a row and a column")
            index = places[0] if len(places) == 1 else ast.Tuple(places, ast.Load())
            node = ast.Subscript(node, index, ast.Load())
        return node

    def _items(self, closing: str) -> list[ast.expr]:
        items: list[ast.expr] = []
        while not self._accept(closing):
            items.append(self._expression())
            if not self._is(closing):
                self._expect(",")
        return items

    def _atom(self) -> ast.expr:
        token = self._take()
        if token.kind == "number":
            return ast.Constant(self._number(token))
        if token.kind == "string":
            return ast.Constant(token.text[1:-1])
        if token.kind == "name":
            if self._accept("("):
                return self._call(token)
            if token.text == "p" and self._is("["):
                begin, depth = self._at, len(self._here.reads)
                self._take()
                numbers = self._items("]")
                if len(numbers) == 6:
                    return _helper("pose", ast.Tuple(numbers, ast.Load()))
                self._at = begin  # a variable of that name, and an index
                del self._here.reads[depth:]
            self._here.reads.append((token.text, token))
            return _variable(token.text, ast.Load())
        if token.text in ("True", "False"):
            return ast.Constant(token.text == "True")
        if token.text == "(":
            inside = self._expression()
            self._expect(")")
            return inside
        if token.text == "[":
            return _helper("array", ast.Tuple(self._items("]"), ast.Load()))
        if token.text == "run":
            name = self._name()
            self._expect("(")
            return _helper("run", self._call(name))
        self._at -= token.kind != "end"
        raise self._wrong("expected a value")

    def _number(self, token: Token) -> float:
        text = token.text
        if text[:2] in ("0x", "0X"):
            return int(text, 16)
        value = int(text) if text.isdecimal() and len(text) < 20 else float(text)
        if not math.isfinite(value):
            raise ScriptError(
                f"syntax_error_on_line:{token.line}:{text}: no number", token.line, token.column
            )
        return value

    def _call(self, name: Token) -> ast.expr:
        positional: list[ast.expr] = []
        named: list[ast.keyword] = []
        while not self._accept(")"):
            self._skip_lines()
            word, after = self._next, self._tokens[min(self._at + 1, len(self._tokens) - 1)]
            if word.kind == "name" and after.text == "=" and after.kind == "sign":
                self._at += 2
                named.append(ast.keyword(word.text, self._expression()))
            else:
                positional.append(self._expression())
            if not self._is(")"):
                self._expect(",")
        call = ast.Call(ast.Name(name.text, ast.Load()), positional, named)
        self._here.calls.append((call, name.text, name))
        return call


def _variable(name: str, use: ast.expr_context) -> ast.Name:
    return ast.Name(f"v_{name}", use)


def _helper(name: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(f"h_{name}", ast.Load()), list(arguments), [])


class _Waits(ast.NodeTransformer):
    """Put ``yield from`` before the calls that take time."""

    def __init__(self, lasting: set[int]) -> None:
        self._lasting = lasting

    def visit_Call(self, node: ast.Call) -> ast.expr:
        is_run = isinstance(node.func, ast.Name) and node.func.id == "h_run"
        if is_run:  # the call is the thread's, not a wait for it
            call = cast("ast.Call", node.args[0])
            call.args = [self.visit(one) for one in call.args]
            return node
        self.generic_visit(node)
        if id(node) not in self._lasting:
            return node
        return ast.YieldFrom(node)
