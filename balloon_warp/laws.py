"""Laws of one's own: created, and checked before anything is simulated.

@wp.func
def magnet(position: wp.vec3, mass: float, strength: float):
    return -mass * strength * position

Simulator(scene, laws=[particle_law(magnet, [Parameter("strength", "1/s^2", 1.0)])])
"""

import ast
import inspect
from collections.abc import Mapping, Sequence
from importlib.resources import files
from textwrap import dedent
from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import LAWS, PARAMETERS, TAKEN, Law, Parameter
from balloon_warp.kernels.laws.law import INPUTS_OF_BOUNDS, LAW_INPUTS, RESULT, Kind
from balloon_warp.system.warp_setup import quiet_warp

TYPES: Mapping[str, tuple[type, ...]] = {
    "vec3": (wp.vec3,),
    "vec4": (wp.vec4,),
    "float": (float, wp.float32),
    "int": (int, wp.int32),
}
"""Accepted Python types for each type of `GIVEN`"""
SAMPLES: Mapping[str, Any] = {
    "vec3": wp.vec3(0.1, 0.2, 0.3),
    "vec4": wp.vec4(0.1, 0.2, 0.3, 0.4),
    "float": 0.5,
    "int": 1,
}
"""Sample arguments with which functions are tried"""


def particle_law(function: Any, parameters: Sequence[Parameter] = (), **more: Any) -> Law:
    """Make a law that gives a force on each particle.

    Args:
        function: A `wp.func` that returns the force, a vector [N]. The names of its arguments select its inputs: things
            of `GIVEN["particle"]`, such as `position`, and parameters.
        parameters: Parameters of the law, in a scene called `balloon.law.NAME.PARAMETER`, or, with `of="world"`,
            `law.NAME.PARAMETER`, unless they have a path.
        more: Fields of `Law`: `name`, `energy`, `neutral`, `wants`, and the bounds `stiffness` and `drag`. Without
            bounds the step of "auto" does not take the law into account.

    Raises:
        InputError: The function does not fit; the sentence names the expected form.
    """
    return _law("particle", function, parameters, more)


def spring_law(function: Any, parameters: Sequence[Parameter] = (), **more: Any) -> Law:
    """Make a law that gives a force along each spring.

    Its function returns the force over the spring's length [N/m]. Otherwise as `particle_law`, with `GIVEN["spring"]`.
    """
    return _law("spring", function, parameters, more)


def face_law(function: Any, parameters: Sequence[Parameter] = (), **more: Any) -> Law:
    """Make a law that gives a force on each face [N].

    Each corner gets the same share. Otherwise as `particle_law`, with `GIVEN["face"]`.
    """
    return _law("face", function, parameters, more)


def require_laws(laws: Sequence[Law]) -> None:
    """Make sure that laws can act beside the built-in ones.

    Raises:
        InputError: one is not right, has the name of another, or a parameter that means something else in another.
    """
    for law in laws:
        require_law(law)
    names: set[str] = {law.name for law in LAWS}
    owners = {name: (row, "a built-in law") for name, row in TAKEN.items()}
    for law in laws:
        if law.name in names:
            raise InputError(f"law {law.name}: another law has this name; expected a unique name")
        names.add(law.name)
        for row in law.parameters:
            known, owner = owners.setdefault(row.name, (row, f"law {law.name}"))
            if known != row:
                raise InputError(
                    f"law {law.name}: its parameter {row.name} is also a parameter of {owner}, with another "
                    "definition; expected another name, or the same row"
                )


def require_law(law: Law) -> None:
    """Make sure that a law can be computed.

    Raises:
        InputError: its function is none of Warp's, or it asks for unknown inputs, or returns another type.
    """
    if not isinstance(law, Law):
        raise InputError(f"laws: expected a Law (got {str(law)[:60]})")
    whose = f"law {law.name}"
    for row in law.parameters:
        _require_row(whose, row)
    rows = {row.name: row for row in law.parameters}
    numbers = {name: "float" if row.size == 1 else "vec3" for name, row in (PARAMETERS | rows).items()}
    types = numbers | {each.name: each.type for each in LAW_INPUTS[law.kind]}
    known = ", ".join([*(each.name for each in LAW_INPUTS[law.kind]), *rows])
    _require_function(whose, law.force, types, RESULT[law.kind], known)
    if law.energy:
        _require_function(f"{whose}: its energy", law.energy, types, "float", known)
    told = [each.name for each in INPUTS_OF_BOUNDS[law.kind]]
    for which, bound in (("stiffness", law.stiffness), ("drag", law.drag)):
        for name in inspect.signature(bound).parameters if bound else ():
            if name not in numbers and name not in told:
                known = ", ".join([*told, *rows])
                raise InputError(f"{whose}: its {which} takes {name}; expected {known or 'no argument'}")
    for name in law.neutral:
        if name not in numbers:
            raise InputError(f"{whose}: neutral names {name}; expected one of its parameters, {', '.join(rows)}")


def _law(kind: Kind, function: Any, parameters: Sequence[Parameter], more: Mapping[str, Any]) -> Law:
    _require_own_function(f"{kind} law", function)
    try:
        law = Law(kind, function, tuple(parameters), **more)
    except TypeError as error:
        raise InputError(f"law {function.func.__name__}: {error}") from None
    require_law(law)
    return law


def _require_row(whose: str, row: Parameter) -> None:
    if PARAMETERS.get(row.name) == row:
        return
    if row.of not in ("world", "balloon"):
        raise InputError(f'{whose}: its parameter {row.name} is of="{row.of}"; expected "balloon" or "world"')
    if row.size not in (1, 3):
        raise InputError(f"{whose}: its parameter {row.name} has size {row.size}; expected 1, or 3 for a vector")
    if not row.path.startswith("law.") or row.path.count(".") != 2:
        raise InputError(f"{whose}: its parameter {row.name} is at {row.path}; expected law.NAME.PARAMETER, or no path")


def _require_own_function(whose: str, function: Any) -> None:
    if not isinstance(function, wp.Function) or function.is_builtin():
        raise InputError(f"{whose}: expected a function with @wp.func before it (got {str(function)[:60]})")


def _require_function(whose: str, function: Any, types: Mapping[str, str], result: str, known: str) -> None:
    """Make sure that a function takes known inputs alone, and that types are right as far as one can tell."""
    _require_own_function(whose, function)
    annotations = inspect.get_annotations(function.func)
    arguments = list(inspect.signature(function.func).parameters)
    for name in arguments:
        if name not in types:
            raise InputError(f"{whose}: unknown argument {name}; expected some of {known}")
        if annotations.get(name, Any) not in (Any, *TYPES[types[name]]):
            expected = TYPES[types[name]][0].__name__
            raise InputError(f"{whose}: its argument {name} is of another type; expected {expected}")
    quiet_warp()  # on the host, too, vectors are added by Warp
    returned = _tried(whose, function, [SAMPLES[types[name]] for name in arguments])
    if returned is not None and not isinstance(returned, TYPES[result]):
        expected = TYPES[result][0].__name__
        raise InputError(f"{whose}: returns a {type(returned).__name__}; expected a {expected}")


def _tried(whose: str, function: Any, samples: Sequence[Any]) -> Any:
    """Call a function on the host; None where the host cannot tell, for not everything in a kernel is there."""
    try:
        returned = function.func(*samples)
    except ArithmeticError:  # with these numbers
        return None
    except Exception as mistake:  # any that somebody else's function lets through
        if _is_for_kernels(mistake):
            return None
        raise InputError(f"{whose}: cannot be called: {str(mistake).splitlines()[0]}") from None
    if returned is None and not any(node.value for node in ast.walk(_tree(function)) if isinstance(node, ast.Return)):
        raise InputError(f"{whose}: returns nothing; expected a return with a value")
    return returned


def _is_for_kernels(mistake: Exception) -> bool:
    """Return whether an error is of a Warp function, or of a native function's result, that only kernels have."""
    if isinstance(mistake, AttributeError) and mistake.obj is wp:
        stubs = files("warp").joinpath("__init__.pyi").read_text(encoding="utf-8")
        return f"def {mistake.name}(" in stubs
    return "function is undefined" in str(mistake) or "NoneType" in str(mistake)


def _tree(function: Any) -> ast.AST:
    return ast.parse(dedent(inspect.getsource(function.func)))
