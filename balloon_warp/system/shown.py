"""Presentation of classes to people: on Tab, in a signature, and of fields in help()."""

import ast
import inspect
import itertools
import textwrap
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import MISSING, fields
from functools import cache
from threading import Lock
from typing import Any, ClassVar, NamedTuple, TypeVar

from balloon_warp.system.loading import hold_in_forks

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
