"""Arrays that a function of Warp reads and writes in the structs that it is handed: found in its source.

So nobody has to declare what a phase does to the state, and no declaration can be wrong: calls are followed, branches
that a scene does not have are left out, and native code writes what its text assigns.
"""

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import warp as wp

Place = tuple[str, str]
"""A parameter, and the path from there to an array, such as ("state", "points"); "" is the parameter itself"""
ASSIGNED = re.compile(r"\b(\w+)\.data\s*\[[^;]*?\]\s*=(?!=)|\b(\w+)\.data\.ptr\s*\[[^;]*?\]\s*=(?!=)")
"""Assignment in native code to an element of a parameter"""


class Effects(NamedTuple):
    """Places of arrays that a function reads or writes."""

    reads: frozenset[Place]
    writes: frozenset[Place]


NONE = Effects(frozenset(), frozenset())


@cache
def effects_of(function: Any) -> Effects:
    """Return the effects of a `wp.func`, with those of all that it calls."""
    return _effects(function, ())


def _effects(function: Any, callers: tuple[Any, ...]) -> Effects:
    if function in callers:  # a form of an overloaded function that calls another one
        return NONE
    parameters = tuple(function.input_types)
    if function.native_snippet is not None:
        names = {name for found in ASSIGNED.findall(function.native_snippet) for name in found if name in parameters}
        return Effects(frozenset(), frozenset((name, "") for name in names))
    definition = next(node for node in ast.walk(function.adj.tree) if isinstance(node, ast.FunctionDef))
    return _Visit(function, parameters, (*callers, function)).effects(definition.body)


class _Visit:
    """Collect the effects of a function's body, where variables may stand for structs."""

    def __init__(self, function: Any, parameters: Sequence[str], callers: tuple[Any, ...]):
        self._callers = callers
        self._known = _variables(function.func)
        self._places: dict[str, Place] = {name: (name, "") for name in parameters}
        self._reads: set[Place] = set()
        self._writes: set[Place] = set()

    def effects(self, body: Sequence[ast.stmt]) -> Effects:
        for node in _executed(body):
            if isinstance(node, ast.Assign):
                self._assign(node.targets[0], node.value)
            elif isinstance(node, ast.Call):
                self._call(node)
            elif isinstance(node, ast.Attribute | ast.Subscript):
                self._access(node)
        return Effects(frozenset(self._reads), frozenset(self._writes))

    def _assign(self, target: ast.expr, value: ast.expr) -> None:
        """Note another name for a struct or an array, or a local struct that holds it: not a copy of an element."""
        place = self._place(value)
        if place and not any(isinstance(each, ast.Subscript) for each in ast.walk(value)):
            self._places[ast.unparse(target)] = place

    def _access(self, node: ast.Attribute | ast.Subscript) -> None:
        place = self._place(node)
        if place and isinstance(node.ctx, ast.Load):
            self._reads.add(place)
        elif place and any(isinstance(each, ast.Subscript) for each in ast.walk(node)):  # not a field of a local struct
            self._writes.add(place)

    def _call(self, node: ast.Call) -> None:
        called = getattr(node.func, "warp_func", None) or _value(node.func, self._known)  # of `wp.static`, or by name
        if not isinstance(called, wp.Function):
            return
        if called.is_builtin():
            if called.key.startswith("atomic_"):
                self._note(self._writes, node.args[0], "")
            return
        for form in [*called.user_overloads.values(), *called.user_templates.values()] or [called]:
            inner = effects_of(form) if form not in self._callers else NONE
            given = dict(zip(form.input_types, node.args, strict=False)) | {
                each.arg: each.value for each in node.keywords
            }
            for into, places in ((self._reads, inner.reads), (self._writes, inner.writes)):
                for parameter, path in places:
                    if parameter in given:
                        self._note(into, given[parameter], path)

    def _note(self, into: set[Place], argument: ast.expr, path: str) -> None:
        place = self._place(argument)
        if place:
            into.add((place[0], ".".join(filter(None, (place[1], path)))))

    def _place(self, node: ast.expr) -> Place | None:
        """Return the place that an expression names: elements belong to their array."""
        if isinstance(node, ast.Name | ast.Attribute) and (text := ast.unparse(node)) in self._places:
            return self._places[text]
        if isinstance(node, ast.Subscript):
            return self._place(node.value)
        if isinstance(node, ast.Attribute):
            base = self._place(node.value)
            if isinstance(node.value, ast.Subscript):
                return base  # a part of an element
            return base and (base[0], ".".join(filter(None, (base[1], node.attr))))
        return None


def _executed(body: Sequence[ast.AST]) -> Iterator[ast.AST]:
    """Find all nodes but those of branches that are never taken, in the order of the source."""
    for node in body:
        if isinstance(node, ast.If) and isinstance(node.test, ast.Constant):  # of `wp.static`
            yield from _executed(node.body if node.test.value else node.orelse)
        else:
            yield node
            yield from _executed(list(ast.iter_child_nodes(node)))


def _variables(function: Any) -> Mapping[str, Any]:
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=False)
    return {**function.__globals__, **{name: cell.cell_contents for name, cell in cells}}


def _value(node: ast.expr, known: Mapping[str, Any]) -> Any:
    if isinstance(node, ast.Name):
        return known.get(node.id)
    if isinstance(node, ast.Attribute):
        return getattr(_value(node.value, known), node.attr, None)
    return None
