"""Public functions and classes to a user: arguments checked by annotations, presentation on Tab and in help()."""

import ast
import collections.abc
import inspect
import itertools
import os
import textwrap
import types
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, fields
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from threading import Lock
from typing import Any, ClassVar, Literal, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError, did_you_mean
from balloon_warp.system.process import hold_in_forks

P = ParamSpec("P")
T = TypeVar("T")
SCALARS: Mapping[Any, tuple[Callable[[Any], bool], str, str]] = {
    str: (lambda value: isinstance(value, str), "text", "texts"),
    Path: (lambda value: isinstance(value, str | os.PathLike), "a path", "paths"),
    bool: (lambda value: isinstance(value, bool | np.bool_), "True or False", "True or False each"),
    int: (lambda value: isinstance(value, Integral) and not isinstance(value, bool), "a whole number", "whole numbers"),
    float: (lambda value: isinstance(value, Real) and not isinstance(value, bool), "a number", "numbers"),
    types.NoneType: (lambda value: value is None, "None", "None each"),
}
"""Test of a value, and the name of one and of several, by type"""
PATHS_AND_VALUES = 'paths and values, as in {"balloon.mass": [1.0, 2.0]}'
NAMED = {"Vary": PATHS_AND_VALUES, "BatchVary": PATHS_AND_VALUES, "TrajectoryFilesLike": "a folder, or TrajectoryFiles"}
"""Names of aliases of types for people"""
PUBLIC = {"BatchPlace": "Cluster"}
"""Class that people make, by its base"""
MOST_SHOWN = 40
"""Characters of a wrong value that are shown at most"""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Check the types of a function's arguments in each call.

    Protocols, arrays and other types that no value can be told by are left to the function.

    Raises:
        InputError: in a call, an argument is not of the type that the function's signature names.
        TypeError: in a call, an argument is missing or has no such name.
    """

    signature = inspect.signature(function)
    hints = cache(lambda: get_type_hints(function))  # which takes as long as some calls: once there is one

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> T:
        _check(_bound(function, signature, arguments, named), hints())
        return function(*arguments, **named)

    return call


def _bound(function: Any, signature: inspect.Signature, arguments: Any, named: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return arguments by their names.

    Raises:
        TypeError: they do not fit the signature; names the function, and the argument that a misspelled one is like.
    """
    try:
        return signature.bind(*arguments, **named).arguments
    except TypeError as error:
        known = [name for name in signature.parameters if name != "self"]
        unknown = next((name for name in named if name not in known), None)
        meant = did_you_mean(unknown, known) or f"; known are {', '.join(known)}" if unknown else ""
        raise TypeError(f"{function.__qualname__.removesuffix('.__init__')}: {error}{meant}") from None


def check_fields(instance: Any) -> None:
    """Check the types of the fields of a dataclass.

    Raises:
        InputError: a field is not of its type.
    """
    _check({field.name: getattr(instance, field.name) for field in fields(instance)}, get_type_hints(type(instance)))


def _check(values: Mapping[str, Any], hints: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if name in hints and not fits(value, hints[name]):
            raise InputError(f"{name}: must be {_said(hints[name])} (got {_shown(value)})")


def fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of an annotated type, as far as that can be told without calling anything of it."""
    if isinstance(hint, TypeAliasType):
        return fits(value, hint.__value__)
    if hint in (Any, ArrayLike):
        return True
    if hint in SCALARS:
        return SCALARS[hint][0](value)
    origin, of = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(fits(value, each) for each in of)
    if origin is Literal:
        return isinstance(value, str | int) and value in of
    if origin is collections.abc.Callable:
        return callable(value)
    if origin in (collections.abc.Mapping, dict):
        return isinstance(value, Mapping) and all(fits(key, of[0]) for key in value)
    if origin in (collections.abc.Sequence, collections.abc.Iterable, list, tuple):
        return _is_row(value, origin) and _items_fit(value, origin, of)
    is_class = isinstance(hint, type) and not getattr(hint, "_is_protocol", False)
    return not is_class or isinstance(value, hint)


def _is_row(value: Any, origin: Any) -> bool:
    """Return whether a value has items in an order; those of an iterator may come once."""
    if origin is collections.abc.Iterable and not isinstance(value, str | bytes):
        return isinstance(value, collections.abc.Iterable)
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _items_fit(row: Any, origin: Any, of: tuple[Any, ...]) -> bool:
    if origin is collections.abc.Iterable:
        return True
    if origin is tuple and of[-1] is not ...:
        return len(row) == len(of) and all(map(fits, row, of))
    return all(fits(item, of[0]) for item in row)


def _said(hint: Any, many: bool = False) -> str:
    """Return the name of a type for people."""
    if isinstance(hint, TypeAliasType):
        return NAMED.get(hint.__name__) or _said(hint.__value__, many)
    if hint in SCALARS:
        return SCALARS[hint][2] if many else SCALARS[hint][1]
    origin, of = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        kinds = [each for each in of if not (each is str and Path in of)]
        said = list(dict.fromkeys(_said(each, many) for each in kinds))
        return " or ".join(filter(None, [", ".join(said[:-1]), said[-1]]))
    if origin is Literal:
        return " or ".join(map(str, of))
    if origin is collections.abc.Callable:
        return "functions" if many else "a function"
    if origin in (collections.abc.Mapping, dict):
        return "dictionaries" if many else "a dictionary"
    if origin is tuple and of[-1] is not ...:
        return f"rows of {len(of)} {_said(of[0], True)}" if many else f"{len(of)} {_said(of[0], True)}"
    if origin in (collections.abc.Sequence, collections.abc.Iterable, list, tuple):
        return f"{'lists' if many else 'a list'} of {_said(of[0], True)}"
    name = getattr(hint, "__name__", str(hint))
    name = PUBLIC.get(name, name)
    return f"{name}s" if many else f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _shown(value: Any) -> str:
    """Return a wrong value as text."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    text = " ".join(repr(value).split())
    return text if len(text) <= MOST_SHOWN else f"{text[: MOST_SHOWN - 3]}..."


PARSING = Lock()
"""Python 3.11 fails where two threads parse at once, as when two recordings are written"""
hold_in_forks(PARSING.acquire, PARSING.release)
WIDTH = 100
"""Width of help [characters]"""
Class = TypeVar("Class", bound=type)


def _doc_of(cls: type) -> str | None:
    said = vars(cls).get("_help")
    return said.whole(cls) if said else vars(cls).get("__doc__")


DOC = property(_doc_of)
"""Docstring of classes with described fields: the `__doc__` of such a type, whose own docstring is a comment"""


class ShownType(ABCMeta):
    # The type of classes of which Tab and help() show the members meant for people.
    __doc__ = DOC  # type: ignore

    def __dir__(cls) -> list[str]:
        bases = [base for base in cls.__mro__ if isinstance(base, ShownType)]
        return cls.shown(name for base in bases for name in vars(base))

    def shown(cls, names: Iterable[str]) -> list[str]:
        """Return the names that are for people, in order."""
        internal = {name for base in cls.__mro__ for name in vars(base).get("_internal", ())}
        return sorted({name for name in names if not name.startswith("_")} - internal)


class Shown(metaclass=ShownType):
    """Base of classes that show only their public names on Tab.

    Names in `_internal` of the class and its bases are left out: other modules use them, and people need not.
    """

    _internal: ClassVar[tuple[str, ...]] = ()

    def __dir__(self) -> list[str]:
        return type(self).shown([*dir(type(self)), *vars(self)])


class FieldHelp(NamedTuple):
    """A field as help() describes it."""

    head: str
    """Name of the field, its default, and accepted values"""
    meaning: str


class Help:
    """A class's docstring, followed by its fields once somebody reads it.

    To find the docstrings below them in the source takes as long as to load them.

    Args:
        fields_of: the help on the fields of a class.
    """

    def __init__(self, fields_of: Callable[[type], Iterator[FieldHelp]]):
        self._fields_of, self._said = fields_of, ""

    def whole(self, cls: type) -> str:
        """Return the text of help() on the class."""
        if not self._said:
            self._said = inspect.cleandoc(plain_docstring(cls))  # for who asks while it is made
            with suppress(OSError):  # the source is not there
                said = [f"{field.head}\n{_indented(field.meaning)}" for field in self._fields_of(cls)]
                self._said = "\n\n".join([self._said, "Fields:", *said])
        return self._said


def _indented(text: str) -> str:
    return textwrap.fill(text, WIDTH, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)


def plain_docstring(cls: type) -> str:
    """Return a class's docstring as it is written, without its fields."""
    return vars(cls).get("__doc__") or ""


def described(cls: Class) -> Class:
    """Describe a dataclass's fields in help(), and name them without types in its signature."""
    describe(cls, _fields_of_dataclass, inspect.signature(cls).parameters.values())
    return cls


def describe(
    cls: type, fields_of: Callable[[type], Iterator[FieldHelp]], parameters: Iterable[inspect.Parameter]
) -> None:
    """Describe a class's fields in help(), and name its parameters without types in its signature."""
    named: dict[str, Any] = {
        "_help": Help(fields_of),
        "__signature__": inspect.Signature([each.replace(annotation=each.empty) for each in parameters]),
    }
    for name, value in named.items():
        setattr(cls, name, value)


def _fields_of_dataclass(cls: type) -> Iterator[FieldHelp]:
    written, said = _annotations(cls), docstrings(cls)
    for field in fields(cls):
        default = "" if field.default is MISSING else f" = {field.default!r}"
        meaning = " ".join(said.get(field.name, "").split())
        yield FieldHelp(f"{field.name}{default} ({written.get(field.name, field.type)})", meaning)


@cache
def docstrings(cls: type) -> dict[str, str]:
    """Return the docstrings below the fields of a class and its bases in the source.

    Raises:
        OSError: the source is not there.
    """
    said: dict[str, str] = {}
    for base in cls.__bases__:
        if getattr(base, "__module__", "").partition(".")[0] == __name__.partition(".")[0]:
            said |= docstrings(base)
    for field, below in itertools.pairwise(_definition(cls).body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and (text := _text(below)):
            said[field.target.id] = inspect.cleandoc(text)
    return said


def _text(statement: ast.stmt) -> str:
    """Return the string that a statement is, if it is nothing else."""
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return str(statement.value.value)
    return ""


def _annotations(cls: type) -> dict[str, str]:
    """Return the annotations of the fields of a class, as they are written."""
    lines = (line for line in _definition(cls).body if isinstance(line, ast.AnnAssign))
    return {ast.unparse(line.target): ast.unparse(line.annotation) for line in lines}


def _definition(cls: type) -> ast.ClassDef:
    with PARSING:
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(definition, ast.ClassDef)
    return definition
