"""Operators of mutation: small faults as replacements of the text of one node of a syntax tree.

What can change no result is left alone:

- floats below `GUARD`, which keep a division from zero, and floats above its inverse, which stand for never or nowhere
- constants with names that are below `TOLERANCE`, or limit passes (`MOST_...`): one that is a little wider is as right
- times and divided by where one side is a sign, or where the sign of the result alone is asked: both have the same
- a `+` of strings and lists
"""

import ast
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

GUARD = 1.0e-9
TOLERANCE = 1.0e-3
LIMIT = "MOST_"
"""Begin of names of limits"""
SIGNS = ("side", "sign")
"""Names of numbers that are 1 or -1"""
TURNED = {"<": ">=", ">": "<=", "<=": ">", ">=": "<", "==": "!=", "!=": "=="}
EXTREMES = {"min": "max", "minimum": "maximum", "fmin": "fmax", "atomic_min": "atomic_max"}
EXTREMES |= {other: one for one, other in EXTREMES.items()}
ALIKE = {"where": 1, "cross": 0, "vec2": 0, "vec3": 0}
"""Functions of Warp and NumPy of which two arguments in a row are of one type: which is the first of them"""
CONDITIONS = ("when", "once")
"""Keywords of a phase that ask a scene's features whether it acts"""


class Edit(NamedTuple):
    """Replacement of some bytes of a file."""

    start: int
    end: int
    text: bytes


class Source:
    """A file, its tree, and where nodes stand in its bytes."""

    def __init__(self, text: bytes):
        self.text = text
        self.tree = ast.parse(text)
        self._lines = [0, *(place + 1 for place, byte in enumerate(text) if byte == 0x0A)]
        self.compared_with_zero = {id(node) for node in _compared_with_zero(self.tree)}
        self.loose = {id(value) for name, value in _named_constants(self.tree) if _is_loose(name, value)}

    def start(self, node: ast.expr | ast.stmt) -> int:
        return self._lines[node.lineno - 1] + node.col_offset

    def end(self, node: ast.expr | ast.stmt) -> int:
        return self._lines[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)

    def of(self, node: ast.expr | ast.stmt) -> bytes:
        """Return a node's text."""
        return self.text[self.start(node) : self.end(node)]

    def replaced(self, node: ast.expr | ast.stmt, text: bytes) -> Edit:
        """Return the edit that gives a node another text."""
        return Edit(self.start(node), self.end(node), text)

    def sign_between(self, left: ast.expr, right: ast.expr, pattern: bytes) -> Edit | None:
        """Return an edit that leaves the operator between two nodes as it is; None if a comment is in between."""
        begin, between = self.end(left), self.text[self.end(left) : self.start(right)]
        found = re.search(pattern, between)
        if found is None or b"#" in between:
            return None
        return Edit(begin + found.start(), begin + found.end(), found.group())


def _compared_with_zero(tree: ast.Module) -> Iterator[ast.expr]:
    """Find the terms of which the sign alone is asked."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and [ast.unparse(each) for each in node.comparators] in (["0.0"], ["0"]):
            yield node.left


def _named_constants(tree: ast.Module) -> Iterator[tuple[str, ast.Constant]]:
    """Find the numbers that a file's top gives names to, alone or in rows."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            pairs = [(node.targets[0], node.value)]
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(node.targets[0].elts, node.value.elts, strict=False))
            for name, value in pairs:
                number = value.args[0] if isinstance(value, ast.Call) and len(value.args) == 1 else value
                if isinstance(name, ast.Name) and isinstance(number, ast.Constant):
                    yield name.id, number


def _is_loose(name: str, number: ast.Constant) -> bool:
    if isinstance(number.value, float):
        return 0.0 < number.value < TOLERANCE
    return name.startswith(LIMIT)


Signatures = Mapping[str, Sequence[Sequence[str | None]]]
"""Annotations of the parameters of all functions of a name"""
Edits = Iterator[Edit | None]


def _operands(node: ast.AST) -> tuple[ast.expr, ast.operator, ast.expr] | None:
    """Return both sides of an operation on numbers, and its operator; None for anything else."""
    if isinstance(node, ast.BinOp):
        sides = node.left, node.op, node.right
    elif isinstance(node, ast.AugAssign):
        sides = node.target, node.op, node.value
    else:
        return None
    others = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp, ast.Set, ast.Dict)
    for side in (sides[0], sides[2]):
        if isinstance(side, others) or (isinstance(side, ast.Constant) and isinstance(side.value, str | bytes)):
            return None
    return sides


def _swapped(node: ast.AST, source: Source, signs: Mapping[type[ast.operator], tuple[bytes, bytes]]) -> Edits:
    if (sides := _operands(node)) and type(sides[1]) in signs:
        old, new = signs[type(sides[1])]
        found = source.sign_between(sides[0], sides[2], re.escape(old))
        yield found and found._replace(text=new)


def _other_sign(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    yield from _swapped(node, source, {ast.Add: (b"+", b"-"), ast.Sub: (b"-", b"+")})
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield Edit(source.start(node), source.start(node) + 1, b"")


def _divided(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    sides = [node.left, node.right] if isinstance(node, ast.BinOp) else []
    if id(node) in source.compared_with_zero or any(ast.unparse(each).rpartition(".")[2] in SIGNS for each in sides):
        return
    yield from _swapped(node, source, {ast.Mult: (b"*", b"/"), ast.Div: (b"/", b"*")})


def _turned(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        found = source.sign_between(node.left, node.comparators[0], rb"[<>=!]=|[<>]")
        yield found and found._replace(text=TURNED[found.text.decode()].encode())


def _other_constant(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if id(node) in source.loose:
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, float) and _is_size(node.value):
        value = {0.0: 0.1, 1.0: 0.9}.get(node.value, float(f"{1.2 * node.value:.6g}"))
        yield source.replaced(node, repr(value).encode())
    numbers = []
    if isinstance(node, ast.BinOp):
        numbers = [node.left, node.right]
    elif isinstance(node, ast.Call) and ast.unparse(node.func) == "wp.constant":
        numbers = node.args
    for each, value in _integers(numbers):
        if id(each) not in source.loose:
            yield source.replaced(each, str(value + 1).encode())


def _is_size(value: float) -> bool:
    return value == 0.0 or GUARD <= abs(value) < 1.0 / GUARD


def _integers(nodes: Sequence[ast.expr]) -> Iterator[tuple[ast.expr, int]]:
    for node in nodes:
        if isinstance(node, ast.Constant) and type(node.value) is int:
            yield node, node.value


def _other_index(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if isinstance(node, ast.Subscript):
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for each, value in _integers(indices):
            yield source.replaced(each, str(value - 1 if value else 1).encode())


def _exchanged(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if not isinstance(node, ast.Call) or any(isinstance(each, ast.Starred) for each in node.args):
        return
    name = ast.unparse(node.func).rpartition(".")[2]
    for place, (one, other) in enumerate(zip(node.args, node.args[1:], strict=False)):
        same_type = ALIKE.get(name) == place if name in ALIKE else _are_alike(signatures.get(name, ()), place)
        if same_type and source.of(one) != source.of(other):
            between = source.text[source.end(one) : source.start(other)]
            yield Edit(source.start(one), source.end(other), source.of(other) + between + source.of(one))


def _are_alike(functions: Sequence[Sequence[str | None]], place: int) -> bool:
    """Return whether all functions of a name take one type at a place and at the next."""
    pairs = {tuple(types[place : place + 2]) for types in functions}
    return len(pairs) == 1 and all(len({*pair}) == 1 < len(pair) and pair[0] not in (None, "Any") for pair in pairs)


def _dropped(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if (sides := _operands(node)) and isinstance(sides[1], ast.Add | ast.Sub):
        if isinstance(node, ast.AugAssign):
            yield source.replaced(node, b"pass")
        elif isinstance(node, ast.BinOp) and (sign := source.sign_between(sides[0], sides[2], rb"[+-]")):
            yield source.replaced(node, source.text[source.start(node) : sign.start].rstrip())


def _other_extreme(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
        before, dot, name = source.of(node.func).decode().rpartition(".")
        if name in EXTREMES:
            yield source.replaced(node.func, f"{before}{dot}{EXTREMES[name]}".encode())


def _negated(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if isinstance(node, ast.Call):
        for each in node.keywords:
            if each.arg in CONDITIONS and isinstance(each.value, ast.Lambda):
                yield source.replaced(each.value.body, b"not (" + source.of(each.value.body) + b")")


def _neighbor(node: ast.AST, source: Source, signatures: Signatures) -> Edits:
    if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple):
        values = node.value.elts
        for each, other in zip(values, [*values[1:], *values[-2:-1]], strict=False):
            if source.of(each) != source.of(other):
                yield source.replaced(each, source.of(other))


OPERATORS: Mapping[str, Callable[[ast.AST, Source, Signatures], Edits]] = {
    "another sign": _other_sign,
    "times or divided by": _divided,
    "a comparison turned": _turned,
    "another constant": _other_constant,
    "another index": _other_index,
    "arguments exchanged": _exchanged,
    "a term dropped": _dropped,
    "minimum or maximum": _other_extreme,
    "a condition negated": _negated,
    "a neighbor returned": _neighbor,
}
"""Possible changes of a node: each finds the edits of it"""
