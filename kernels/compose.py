"""Composition of laws: one function of Warp that adds up all laws of a kind, made from text; and parameters of an item.

A law's arguments name its inputs, so that the sum is written out with just those: no law is paid for by scenes that do
not have it, and no schedule knows any.

Functions that are called by others have derivatives wherever Warp meets them first. `wp.grad` asks for the adjoint of a
function, and Warp asks for those of its callees as it reads it. But it reads each function once. A function that it has
read before, for a call without derivatives, is not read again, and the helpers of that helper stay without adjoints:
their derivatives are then 0, silently. Here they are requested, once all has been read. Callers of a function with a
`wp.grad` in it are written after that, as if they had one themselves.
"""

import inspect
import linecache
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.lanes import number_in, of_lane
from balloon_warp.kernels.laws import Columns
from balloon_warp.kernels.laws.law import LAW_INPUTS, Kind, Law
from balloon_warp.kernels.memory import float_at, int_at, two_in
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world


def function_from(name: str, source: str, names: Mapping[str, Any]) -> Any:
    """Return a `wp.func` of a text, which Warp reads again by the file that is noted for it.

    Args:
        names: objects that the text may refer to, by name.
    """
    return wp.func(_read(name, source, names))


def _read(name: str, source: str, names: Mapping[str, Any]) -> Any:
    """Return the function of a text."""
    filename = f"<balloon_warp {name} {hash(source):x}>"
    linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
    space = {"wp": wp, "Any": Any, **names}
    exec(compile(source, filename, "exec"), space)
    return space[name]


def kernel_from(name: str, source: str, names: Mapping[str, Any], **options: Any) -> Any:
    """Return a kernel of a text, in a module of its own.

    Args:
        names: objects that the text may refer to, by name.
        options: of `wp.kernel`.
    """
    return wp.kernel(_read(name, source, names), module="unique", enable_backward=False, **options)


HOOK = "_propagate_used_by_backward_kernel"
"""Method of Warp's that runs between reading and writing; it does the same for kernels with a backward pass"""


def derive_helpers() -> None:
    """Make Warp generate the adjoints of all helper functions."""
    from warp._src.context import ModuleBuilder

    before = getattr(ModuleBuilder, HOOK)
    if before.__name__ != _and_helpers.__name__:
        setattr(ModuleBuilder, HOOK, _and_helpers(before))


def _and_helpers(before: Callable[[Any], None]) -> Callable[[Any], None]:
    def propagate(builder: Any) -> None:
        before(builder)
        for function in builder.functions:  # callees come first
            if any(each.adj.uses_grad_call for each in function.adj.called_user_functions):
                function.adj.uses_grad_call = True
        asked = [function.adj for function in builder.functions if function.adj.force_adjoint_codegen]
        while asked:
            for helper in asked.pop().called_user_functions:
                if not helper.adj.force_adjoint_codegen:
                    helper.adj.force_adjoint_codegen = True
                    asked.append(helper.adj)

    propagate.__name__ = _and_helpers.__name__
    return propagate


NOTHING: Mapping[str, str] = {"vec3": "wp.vec3()", "float": "0.0"}
"""Source of an empty sum, by type"""
AIR = "air"
"""Name of the quantity that laws get from the air at their place"""
Air = tuple[Any, ...]
PLACES = ("position", "center")
"""Argument with the place of a law, by the law's kind"""


def arguments_of(law: Law) -> list[str]:
    """Return the names of the law's arguments."""
    return list(inspect.signature(law.force.func).parameters)


def any_names(laws: Sequence[Law], given: str) -> bool:
    """Return whether one of the laws has an argument."""
    return any(given in arguments_of(law) for law in laws)


@cache
def sum_of_laws(kind: Kind, result: str, laws: tuple[Law, ...], columns: Columns, air: Air = ()) -> Any:
    """Return a function that sums the laws of a kind.

    Its arguments are all quantities that such laws may take, in the order of `GIVEN`, except the air, and the row `n`
    of their numbers.

    Args:
        air: Functions that give velocity and density of the air at a place, where a law names the air.
    """
    given = [each.name for each in LAW_INPUTS[kind]]
    return _summed(f"{kind}_laws", result, laws, columns, given, air, Spelling())


@cache
def laws_added(kind: Kind, result: str, laws: tuple[Law, ...], columns: Columns, air: Air = ()) -> Any:
    """Return a function that adds the laws of a kind to its first argument, one after the other.

    A law that is a product thereby becomes a fused multiply-add. The other arguments are those of `sum_of_laws`.
    """
    given = [each.name for each in LAW_INPUTS[kind]]
    return _summed(f"{kind}_laws_added", result, laws, columns, given, air, Spelling(begin="so_far"))


@cache
def sum_of_laws_in_lane(kind: Kind, result: str, laws: tuple[Law, ...], columns: Columns, air: Air = ()) -> Any:
    """Return a function that sums the laws of a kind in one of eight lanes.

    Arguments are of eight lanes, or alike in all; `n` is a row of lanes.
    """
    given = [each.name for each in LAW_INPUTS[kind]]

    def told(name: str) -> str:
        return f"of_lane({name}, lane)"

    def number(column: int, size: int) -> str:
        return _number(column, size, "[lane]")

    spelling = Spelling(told, number, "n: Any, lane: wp.int32")
    return _summed(f"{kind}_laws_in_lane", result, laws, columns, given, air, spelling)


@cache
def sum_of_laws_of_few(
    kind: Kind, result: str, laws: tuple[Law, ...], columns: Columns, air: Air = ()
) -> tuple[Any, tuple[int, ...]]:
    """Return the function `sum_of_laws` for a row of just the numbers that the laws name, and these one's columns."""
    given, few = [each.name for each in LAW_INPUTS[kind]], []

    def number(column: int, size: int, of_which: str = "") -> str:
        few.extend(each for each in range(column, column + size) if each not in few)
        parts = [f"n[{few.index(each)}]" for each in range(column, column + size)]
        return parts[0] if size == 1 else f"wp.vec3({', '.join(parts)})"

    return _summed(f"{kind}_laws_of_few", result, laws, columns, given, air, Spelling(number=number)), tuple(few)


@cache
def sum_of_resistances(laws: tuple[Law, ...], columns: Columns, air: Air = ()) -> Any:
    """Return a function that sums the resistances of laws on a particle, of the arguments of `sum_of_laws`."""
    resisting = tuple(replace(law, force=law.resistance) for law in laws if law.resistance)
    return sum_of_laws("particle", "float", resisting, columns, air)


@cache
def choice_of_laws(laws: tuple[Law, ...], columns: Columns) -> Any:
    """Return a function that calls the membrane law of number `material`.

    Its other arguments are all quantities that such laws take, and the row `n` of numbers, of one of eight lanes where
    it is of lanes.
    """
    return _chosen(laws, columns, _number_in_lane, lambda: ["n: Any", "lane: wp.int32"])


@cache
def choice_of_laws_of_few(laws: tuple[Law, ...], columns: Columns) -> tuple[Any, tuple[int, ...]]:
    """Return the function `choice_of_laws` for just the numbers that laws name, and their columns.

    Each number is an argument of its own, after the material.
    """
    few: list[int] = []

    def number(column: int, size: int) -> str:
        few.extend(each for each in range(column, column + size) if each not in few)
        parts = [f"n{few.index(each)}" for each in range(column, column + size)]
        return parts[0] if size == 1 else f"wp.vec3({', '.join(parts)})"

    return _chosen(laws, columns, number, lambda: [f"n{place}: float" for place in range(len(few))]), tuple(few)


def _chosen(
    laws: tuple[Law, ...], columns: Columns, number: Callable[[int, int], str], rest: Callable[[], list[str]]
) -> Any:
    """Return a function that calls the membrane law of a number, by its quantities, the number, and the rest."""
    given = [each.name for each in LAW_INPUTS["membrane"]]
    called = {f"law_{place}": law.force for place, law in enumerate(laws)}
    calls = [call_of(force, each, given, columns, number=number) for each, force in called.items()]
    lines = [f"    by_trace, by_det = {calls[0]}"]
    for place, call in enumerate(calls[1:], 1):
        lines += [f"    if material == {place}:", f"        other_trace_{place}, other_det_{place} = {call}"]
        lines += [f"        by_trace = other_trace_{place}", f"        by_det = other_det_{place}"]
    arguments = ", ".join([*(f"{each}: float" for each in given), "material: wp.int32", *rest()])
    source = "\n".join([f"def membrane_laws({arguments}):", *lines, "    return by_trace, by_det\n"])
    return function_from("membrane_laws", source, {"number_in": number_in, **called})


@cache
def choice_of_energies(laws: tuple[Law, ...], columns: Columns) -> Any:
    """Return a function that calls the energy of the membrane law of number `material` [J/m^3]."""
    given = [each.name for each in LAW_INPUTS["membrane"]]
    called = {f"energy_{place}": law.energy for place, law in enumerate(laws)}
    calls = [call_of(energy, each, given, columns, number=_number_in_lane) for each, energy in called.items()]
    lines = [f"    energy = {calls[0]}"]
    for place, call in enumerate(calls[1:], 1):
        lines += [f"    if material == {place}:", f"        energy = {call}"]
    arguments = ", ".join([*(f"{each}: float" for each in given), "material: wp.int32, n: Any, lane: wp.int32"])
    source = "\n".join([f"def membrane_energies({arguments}):", *lines, "    return energy\n"])
    return function_from("membrane_energies", source, {"number_in": number_in, **called})


def _number_in_lane(column: int, size: int) -> str:
    parts = [f"number_in(n, {each}, lane)" for each in range(column, column + size)]
    return parts[0] if size == 1 else f"wp.vec3({', '.join(parts)})"


def _number(column: int, size: int, of_which: str = "") -> str:
    parts = [f"n[{each}]{of_which}" for each in range(column, column + size)]
    return parts[0] if size == 1 else f"wp.vec3({', '.join(parts)})"


def call_of(
    function: Any,
    name: str,
    given: Sequence[str],
    columns: Columns,
    told: Callable[[str], str] = str,
    number: Callable[[int, int], str] = _number,
) -> str:
    """Return the text of a call with the function's own arguments."""
    arguments = [
        told(each) if each in given else number(columns.places[each], columns.sizes[each])
        for each in inspect.signature(function.func).parameters
    ]
    return f"{name}({', '.join(arguments)})"


def function_here(function: Any, given: Sequence[str], columns: Columns) -> Any:
    """Return a function of some given numbers and a row `n`, which calls one that names those and parameters."""
    name = function.key
    arguments = ", ".join([*(f"{each}: float" for each in given), "n: Any"])
    source = f"def {name}_here({arguments}):\n    return {call_of(function, name, given, columns)}\n"
    return function_from(f"{name}_here", source, {name: function})


class Spelling(NamedTuple):
    """Text of a sum's arguments."""

    told: Callable[[str], str] = str
    """Returns the text that finds a quantity of a name"""
    number: Callable[[int, int], str] = _number
    """Returns the text that finds a number, by its column and size"""
    row: str = "n: Any"
    """Parameters that hold the numbers"""
    begin: str = ""
    """Parameter to which the laws are added, if any"""


def _summed(
    name: str,
    result: str,
    laws: Sequence[Law],
    columns: Columns,
    given: Sequence[str],
    air: Air,
    spelling: Spelling,
) -> Any:
    told, number, row, begin = spelling

    def told_or_found(each: str) -> str:
        return each if each == AIR else told(each)

    called = {f"law_{place}": law.force for place, law in enumerate(laws)}
    calls = [call_of(force, each, given, columns, told_or_found, number) for each, force in called.items()]
    begins = [begin] if begin else []
    arguments = ", ".join([*(f"{each}: Any" for each in (*begins, *given) if each != AIR), row])
    lines = [f"def {name}({arguments}):"]
    if any_names(laws, AIR):
        at = {"place": told(next(each for each in PLACES if each in given)), "up": told("up"), "time": told("time")}
        for each, function in zip(("velocity_there", "density_there"), air, strict=True):
            called[each] = function
            lines.append(f"    {each}_ = {call_of(function, each, list(at), columns, at.__getitem__, number)}")
        parts = ", ".join(f"velocity_there_[{axis}]" for axis in range(3))
        lines.append(f"    {AIR} = wp.vec4({parts}, density_there_)")
    source = "\n".join([*lines, f"    return {' + '.join([*begins, *calls]) or NOTHING[result]}\n"])
    return function_from(name, source, {"of_lane": of_lane, **called})


@wp.struct
class Clock:
    """Clock of launches: a substep's time in the frame, however often its recording is replayed."""

    done: wp.array[wp.int32]
    """Number of substeps by which the frame is further on than the number that a launch is given says; one entry"""
    left: wp.array[wp.int32]
    """Turns that rounds have yet to make, see `frame.begin_round`; two entries, the second of rounds within rounds"""
    substep_seconds: wp.float64


@wp.func
def time_in_frame_of(clock: Clock, substep: wp.int32):
    """Return the time at which a substep begins [s]."""
    return float(wp.float64(clock.done[0] + substep) * clock.substep_seconds)


@wp.func
def time_of(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """Return the time since the simulation began [s]."""
    return float(frame[0]) * t.frame_seconds + time_in_frame


@wp.func
def ramp_at(state: WorldState, world: wp.int32, balloon: wp.int32, time_in_frame: float):
    """Return a keyframed value, such as k_normal, at a time in the frame."""
    ramp = two_in(state.inflation_ramp, world, balloon)
    return ramp[0] + ramp[1] * time_in_frame


@cache
def numbers_type(width: int) -> Any:
    """Return the type of a row of parameters in registers."""
    return wp.types.vector(length=width, dtype=wp.float32)


@cache
def numbers_reader(columns: Columns) -> Any:
    """Return the function that reads a balloon's parameters.

    The compiler leaves out numbers that no law names.
    """
    split = columns.balloon_width
    lines = [f"    n[{column}] = float_at(of_balloon, {column})" for column in range(split)]
    lines += [f"    n[{split + column}] = float_at(of_world, {column})" for column in range(columns.world_width)]
    source = "\n".join(
        [
            "def read_numbers(t: Tables, world: wp.int32, balloon: wp.int32):",
            "    of_balloon = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon]",
            "    of_world = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]",
            "    n = Numbers()",
            *lines,
            "    return n\n",
        ]
    )
    names = {"Tables": Tables, "row_of_world": row_of_world, "float_at": float_at}
    return function_from("read_numbers", source, names | {"Numbers": numbers_type(columns.width)})


@cache
def params_functions(columns: Columns, balloons: int = 0) -> tuple[Any, Any]:
    """Return the type of a particle's parameters and indices, and the function that reads them.

    Args:
        balloons: of a world, where that is known: of a single one less has to be read.
    """
    Numbers = numbers_type(columns.width)  # noqa: N806 - a type
    read_numbers = numbers_reader(columns)
    mass_column = columns.places["mass"]

    @wp.struct
    class Params:
        """Parameters and indices of a particle."""

        world: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32  # of its balloon's inflation
        share: float  # of its balloon's mass, 0 if it is fixed
        mass: float  # without gas [kg]
        n: Numbers  # its balloon's and its world's parameters

    @wp.func
    def read_params(t: Tables, world: wp.int32, particle: wp.int32):
        """Read all parameters and indices of a particle."""
        params = Params()
        params.world = world
        params.number = particle
        if wp.static(balloons != 1):
            params.balloon = int_at(t.particles.balloon, particle)
        params.kind = int_at(t.inflation_kind, params.balloon)
        params.share = float_at(t.particles.mass_share, particle)
        params.n = read_numbers(t, world, params.balloon)
        params.mass = params.share * params.n[mass_column]
        return params

    return Params, read_params


@cache
def params_beside_function(columns: Columns, balloons: int = 0) -> Any:
    """Return the function that reads a particle's own data, where its balloon's and world's are already read."""
    Params, _ = params_functions(columns, balloons)  # noqa: N806 - a type
    mass_column = columns.places["mass"]

    @wp.func
    def read_params_beside(t: Tables, beside: Params, particle: wp.int32):
        """Read a particle's parameters and indices, with those of its balloon and world already read."""
        params = Params()
        params.world = beside.world
        params.number = particle
        params.balloon = beside.balloon
        params.kind = beside.kind
        params.n = beside.n
        params.share = float_at(t.particles.mass_share, particle)
        params.mass = params.share * params.n[mass_column]
        return params

    return read_params_beside
