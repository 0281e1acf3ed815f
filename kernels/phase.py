"""Phase of a substep: the work of one item of a world between two barriers, its effects, and the adjoint of it.

Its function is one of Warp, of plain arguments. Their names are its inputs, those in `writes` its results. So a
schedule, which knows no physics, can execute any list of phases: it finds the inputs of each, keeps those of a later
one, and puts a barrier where one looks at results of others. The step is such a list, see `substep`.

A name that a phase reads is one of these:

- a handle: `t`, the tables; `state`; `working`, the buffers of contact beside the state; `spheres`. What a phase reads
  and changes through them has names, too, see `tables.NAMED`, which follow from its source
- the item: `world`, and within it `balloon`, `particle`, `face`, `triangle` or `sphere`, or all `threads` of a block
- `params`, a particle's own parameters, see `compose`; a row of numbers of a law, by its name
- `number`, a particle's in the state, where a schedule has particles in another order
- state of a particle, `point` [m] and `velocity` [m/s], or a view of all in its world, `points` and `velocities`
- a value that an earlier phase of the list has written, or that an item keeps, see `Phase.keeps`
- the time: `time` when the substep begins, and `end` when it ends, since the frame began [s]
- values that a schedule itself has of items, see there: `keyed`, `load`, `gas_mass`, `origin`

Where all that it reads is of type `Any`, it is a function of one item or of eight side by side, see `algebra`.

Which arrays a function of Warp reads and writes in the structs that it is handed is found in its source. So nobody has
to declare what a phase does to the state, and no declaration can be wrong: calls are followed, branches that a scene
does not have are left out, and native code writes what its text assigns.

A list of phases runs backwards by their adjoints. Let L be a number that depends on where a scene ends. The *bar* of a
value is the derivative of L by that value. A phase's adjoint takes the bars of the phase's outputs, and returns those
of its inputs. Like a phase, it names its arguments: `velocity_bar` is the bar of a particle's own `velocity`,
`force_bars` a view of those of all particles of its world. So a schedule, which knows no physics, can run any list
backwards, see `schedules.launched_backward`.
"""

import ast
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, NamedTuple

import warp as wp

from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.features import Features, Kept
from balloon_warp.kernels.lanes import Lanes
from balloon_warp.kernels.laws.law import Parameter
from balloon_warp.kernels.memory import add_at, put_vector, vector_at
from balloon_warp.kernels.tables import OF_ARRAY, Tables, names_of
from balloon_warp.kernels.warps import sum_over_block


class Adjoint(NamedTuple):
    """Hold a function that returns bars."""

    function: Any
    """Function of Warp; its arguments name its inputs"""
    of: tuple[str, ...]
    """Names whose bars it returns, in order: of the phase's inputs, or of its outputs, to be added there"""
    of_face: Any = None
    """Function of a face of a membrane that runs for all faces before, and leaves the bars of its corners there; it
    returns the bar of the balloon's numbers. None if there is none"""
    of_eight: Any = None
    """Function that adds all that `function` finds of a world's particles, eight at a time, for a CPU, see
    `adjoints.springs`. None if there is none"""
    columns: tuple[int, ...] = ()
    """Columns of the balloon's and the world's numbers whose bars it returns, where that is not all of them"""


class NoAdjointError(Exception):
    """Error of a phase without an adjoint for a feature of the scene, which the message names."""


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


Item = Literal[
    "world", "balloon", "particle", "face", "triangle", "quad", "hinge", "spring", "element", "membrane_face", "sphere",
    "team", "launches",
]  # fmt: skip
"""Item that a phase works on: `quad` is a quad or triangle of a membrane, `film` a face of one; `element` a spring,
string, hinge, triangle or face; `team` all threads of a block, for a world; `launches` the host"""
VIEWS = {"points": "point", "velocities": "velocity", "face_centers": "face_center", "face_areas": "face_area",
         "face_pushes": "face_push"}  # fmt: skip
"""Views of all items, and the value that each item has in a view"""
HANDLES = ("t", "state", "working", "spheres")
"""Structs through which a phase reads and writes state of other items"""
WITHIN_LANES = "all."
"""Path from the tables of lanes to those of all schedules"""
TIMES = ("time", "end", "time_in_frame")
"""Times that are the same for all items"""
KEEPERS = ("particle", "face", "triangle", "balloon", "sphere", "world")
"""Items that can keep values from one substep to the next"""
STATE = {"point": "points", "velocity": "velocities"}
"""State of a particle from one substep to the next, and the arrays that hold it"""


class Access(NamedTuple):
    """Accessors through which the items of a schedule read each other."""

    at: Any
    """Function that reads a point from a view"""
    sphere_at: Any
    """Function that returns a sphere's center, velocity and radius"""
    loops: Callable[[Features], Any]
    """Loops over the forces on a particle, see `loops.net_force`"""
    slots: tuple[int, int, int] | None = None
    """Largest number of springs of each kind at a particle, where loops have them in slots, see `loops.springs`"""
    ring: int = 0
    """Least number of quads around a particle, where its slots go around it, so that area vectors follow; else 0"""
    alone: Callable[[Features], bool] = lambda features: False
    """Whether a particle's forces depend on no other particle"""
    put: Any = put_vector
    """Function that writes a point into a view"""
    velocity_at: Any = vector_at
    put_velocity: Any = put_vector
    in_team: tuple[Any, Any, Any] = (vector_at, put_vector, sum_over_block)
    """Functions that read and write a point or velocity, and that sum over threads, for phases of a whole block"""
    add: Any = add_at
    """Function that adds a force to those in a view"""
    add_to_corners: Any = None
    """Function that adds to the four corners of a quad, or of eight; None where faces leave forces for their corners"""
    world: Any = None
    """Function that returns the world of one of eight lanes, where eight run side by side; None elsewhere"""
    membrane_faces: Callable[[Features], Any] = lambda features: None
    """Membrane phases of faces, where each is measured once, see `phases.forces.stretch`"""


@dataclass(frozen=True, eq=False)
class Phase:
    """Describe one line of a list of phases."""

    name: str
    item: Item
    make: Callable[[Features, Access], Any]
    """Factory of the phase's function for a scene's features"""
    writes: Mapping[str, Any] = field(default_factory=dict)
    """Names of the values that it returns, in order, and their types; a sum belongs to the balloon"""
    when: Callable[[Features], bool] = lambda features: True
    """Predicate of the features, whether a scene has the phase"""
    sums: bool = False
    """Whether the returned values are summed over each balloon's items before they may be read"""
    light: bool = False
    """Whether the value is recomputed wherever it is read, not kept, since it is constant over a substep, or over a
    frame if it is computed once"""
    once: Callable[[Features], bool] = lambda features: False
    """Predicate of the features, whether the phase runs only as a frame begins"""
    rare: Callable[[Features, Access], Any] | None = None
    """Function that returns whether the phase acts on an item, or on any of eight; where it does not, its values stay
    as they were, or are zero. A schedule may call it first"""
    last: bool = False
    """Whether the phase runs only as a frame ends"""
    due: Callable[[Features], Any] | None = None
    """Function of handles alone that returns whether there is anything to do: runs in one thread of a block"""
    also_reads: tuple[str, ...] = ()
    """Values that a phase of the host reads"""
    adjoint: "Adjoints | None" = None
    """Factory of the phase's adjoints, see `adjoint`; None where they are not known"""
    rows: tuple[Parameter, ...] = ()
    """Rows of its parameters, as of laws: of balloons, spheres or the world"""
    neutral: Mapping[str, float] = field(default_factory=dict)
    """Values of parameters at which the phase changes nothing and is left out"""
    wants: Callable[[Any], bool] | None = None
    """Predicate of a scene, whether the phase belongs to it; all scenes, when missing"""
    keeps: Mapping[str, Any] = field(default_factory=dict)
    """Values among those that it writes that each item keeps from substep to substep and from frame to frame, and
    their start values. An earlier phase, too, reads the last kept value, and `NAMEs` is the view of all items'"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", tuple(row.placed(self.name) for row in self.rows))
        if self.keeps and self.item not in KEEPERS:
            raise TypeError(f"{self.name}: a {self.item} keeps no values; expected one of {', '.join(KEEPERS)}")

    def is_active(self, features: Features) -> bool:
        """Return whether a scene has the phase."""
        is_asked = self.neutral or self.wants
        return self.when(features) and (not is_asked or self.name in features.active)

    @property
    def kept(self) -> tuple[Kept, ...]:
        """The values that its items keep."""
        return tuple(Kept(name, self.item, self.writes[name], start) for name, start in self.keeps.items())

    @property
    def summary(self) -> str:
        """Return the phase's purpose, in a line."""
        return " ".join((self.make.__doc__ or self.name).partition("\n\n")[0].split())

    def function(self, features: Features, access: Access) -> Any:
        """Return the phase's `wp.func` for a scene's features."""
        return _made(self, features, access)

    def reads(self, features: Features, access: Access) -> tuple[str, ...]:
        """Return the names that the phase reads: those of its arguments."""
        if self.item == "launches":
            return self.also_reads
        return tuple(_arguments(self.function(features, access)))

    def reads_state(self, features: Features, access: Access) -> frozenset[str]:
        """Return the names of the state that the phase reads through handles, see `tables.NAMED`."""
        return names_of(_reached(self, features, access, "reads"))

    def changes(self, features: Features, access: Access) -> frozenset[str]:
        """Return the names of the state that the phase changes through handles, see `tables.NAMED`.

        Raises:
            TypeError: it writes an array that has no name.
        """
        arrays = _reached(self, features, access, "writes")
        if strange := sorted(set(arrays) - OF_ARRAY.keys()):
            raise TypeError(
                f"phase {self.name}: writes `{strange[0]}`, which has no name; expected arrays of "
                "kernels.tables.NAMED, or values that the phase writes or keeps"
            )
        return names_of(arrays)

    def takes_eight(self, features: Features, access: Access) -> bool:
        """Return whether the phase runs on eight items side by side: it names no type of one item.

        State of other items is visited one by one, but by quads.
        """
        told = _arguments(self.function(features, access))
        are_any = all(each.annotation is Any or name in TIMES for name, each in told.items())
        return are_any and (self.item == "quad" or features.kept_views.keys().isdisjoint(told))

    def adjoints(self, features: Features, access: Access) -> Sequence[Adjoint]:
        """Return the phase's adjoints.

        Raises:
            NoAdjointError: nothing does.
        """
        return _turned(self, features, access)

    def asked(self, features: Features, access: Access) -> Any:
        """Return the function that returns whether the phase has work, or None where it may always have some."""
        return _asked(self, features, access) if self.rare else None

    def views(self, features: Features, access: Access) -> set[str]:
        """Return the values of other items that the phase reads: they must not be written meanwhile."""
        views = VIEWS | features.kept_views
        return {views[name] for name in self.reads(features, access) if name in views}


Adjoints = Callable[[Phase, Features, Access], Sequence[Adjoint]]
"""Factory of a phase's adjoints, in the order in which they run; those that look at other particles come last"""


@cache
def _made(phase: Phase, features: Features, access: Access) -> Any:
    return phase.make(features, access)


@cache
def _arguments(function: Any) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(function.func).parameters


@cache
def _reached(phase: Phase, features: Features, access: Access, how: Literal["reads", "writes"]) -> tuple[str, ...]:
    """Return the arrays that a phase reads or writes through its handles."""
    if phase.item == "launches":
        return ()
    places = getattr(effects_of(phase.function(features, access)), how)
    paths = (path.removeprefix(WITHIN_LANES) for handle, path in sorted(places) if handle in HANDLES)
    return tuple(dict.fromkeys(filter(None, paths)))


@cache
def _asked(phase: Phase, features: Features, access: Access) -> Any:
    return phase.rare(features, access) if phase.rare else None


@cache
def _turned(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    if phase.adjoint is None:
        raise NoAdjointError(phase.name)
    return tuple(phase.adjoint(phase, features, access))


def phase(item: Item, writes: Mapping[str, Any] | None = None, **said: Any) -> Callable[[Any], Phase]:
    """Decorate a `wp.func`, or the factory of one for a scene's features: it becomes the phase, named alike."""

    def named(made: Any) -> Phase:
        if not isinstance(made, wp.Function):
            return Phase(made.__name__, item, made, writes or {}, **said)

        def make(features: Features, access: Access) -> Any:
            return made

        function: Any = made.func
        make.__doc__ = function.__doc__
        return Phase(function.__name__, item, make, writes or {}, **said)

    return named


NOT_DIFFERENTIATED = frozenset(
    {
        *("t", "constants", "state", "working", "springs", "spheres", "world", "balloon", "particle", "face"),
        *("time", "end", "time_in_frame", "points", "velocities"),
    }
)
"""Names without a bar of their own: handles, items, times and views"""


@wp.struct
class Constants:
    """Numbers of the tables that most phases read; whole tables would be copied for a derivative."""

    up: wp.vec3
    step_seconds: float


@wp.func
def constants_of(t: Tables):
    """Return the constants of a step."""
    constants = Constants()
    constants.up = t.up
    constants.step_seconds = t.step_seconds
    return constants


@wp.func
def lanes_pairing(values: Lanes, bars: Lanes):
    """Pairing of numbers with their bars, summed over lanes: each lane's number gets its own bar."""
    return wp.dot(values, bars)


@wp.func
def lanes_pairing(values: Any, bars: Any):  # noqa: F811 - an overload
    """Pairing of several numbers with their bars, summed over lanes."""
    return wp.ddot(values, bars)


def nothing(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Empty adjoint of a phase that nothing depends on, or whose value is constant to a derivative."""
    return ()


def by_grad(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of a phase's function, derived by Warp."""
    return by_grad_but()(phase, features, access)


def by_grad_but(*frozen: str) -> Adjoints:
    """Warp's adjoint of a phase, by a factory with some arguments constant."""

    def factory(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
        if access.world and not phase.takes_eight(features, access):
            raise NoAdjointError(f"{phase.name}, which takes no eight at a time,")
        function = phase.function(features, access)
        reads = ["constants" if name == "t" else name for name in phase.reads(features, access)]
        bars = [f"{name}_bar" for name in phase.writes]
        results = [f"{name}_result" for name in phase.writes]
        products = [
            _product(value, bar, dtype, bool(access.world))
            for value, bar, dtype in zip(results, bars, phase.writes.values(), strict=True)
        ]
        arguments = [*reads, *bars]
        of = tuple(name for name in reads if name not in NOT_DIFFERENTIATED and name not in frozen)
        typed = ", ".join(f"{name}: Any" for name in arguments)
        work = "\n".join(
            [
                f"def {phase.name}_work({typed}):",
                f"    {', '.join(results)} = {phase.name}({', '.join(reads)})",
                f"    return {' + '.join(products)}\n",
            ]
        )
        names = {phase.name: function, "lanes_pairing": lanes_pairing}
        names[f"{phase.name}_work"] = function_from(f"{phase.name}_work", work, names)
        adjoint = "\n".join(
            [
                f"def {phase.name}_adjoint({typed}):",
                f"    {', '.join(f'by_{name}' for name in arguments)} = wp.grad({phase.name}_work)"
                f"({', '.join(arguments)})",
                f"    return {', '.join(f'by_{name}' for name in of)}\n",
            ]
        )
        return (Adjoint(function_from(f"{phase.name}_adjoint", adjoint, names), of),)

    return factory


def _product(value: str, bar: str, dtype: Any, of_eight: bool) -> str:
    """Text of the pairing of a value with its bar, over components and lanes."""
    if of_eight:
        return f"lanes_pairing({value}, {bar})"
    return f"{value} * {bar}" if dtype is float else f"wp.dot({value}, {bar})"
