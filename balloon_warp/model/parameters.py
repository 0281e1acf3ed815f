"""The parameters that may differ between worlds: where each stands in the scene, and in the model."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.scene import Ground, Scene, Water
from balloon_warp.scene.overrides import override_scene

Parameters = dict[str, NDArray[np.float64]]
"""arrays by their names in `Model`; the leading dimension is world_count, or 1 for all worlds alike"""
Vary = Mapping[str, ArrayLike]
"""a dotted path of the scene, as in overrides, and its value in each world, shape (world_count,)"""
Place = tuple[str, tuple[int | slice, ...]]
"""an array of `Parameters`, and an index into each world's part of it"""

METHODS = ("substeps", "solver", "normals", "correction", "correction_sweeps", "contact")
"""fields of the scene that are no parameters, and may change during a simulation all the same"""
KINDS = ("structural", "shear", "flexion")
NEVER_YIELDS = 1.0e9
"""the stretch at which springs yield that do not yield: 1 - 1 / stretch is 1 in float32"""
NO_GROUND = Ground.model_construct(height=-np.inf, friction=0.0, restitution=0.0)
NO_WATER = Water.model_construct(level=-np.inf, density=0.0, drag=0.0)
SURROUNDINGS = {"ground": ("height", "friction", "restitution"), "water": ("level", "density", "drag")}
"""tables of which a scene has one or none, and their fields"""


def scene_parameters(scene: Scene) -> Parameters:
    """What the scene says, alike in all worlds; NaN where it leaves out a string's length or an amount of gas."""
    air = scene.atmosphere
    balloons, spheres, strings = scene.balloon, scene.sphere, scene.string
    ground, water = scene.ground or NO_GROUND, scene.water or NO_WATER
    keyframes = [balloon.inflation.keyframes for balloon in balloons]
    longest = max(len(keys) for keys in keyframes)
    return {
        "stiffness": np.array([[[getattr(balloon.stiffness, kind) for kind in KINDS] for balloon in balloons]]),
        "correction_limit": np.array([scene.correction_limit]),
        "torsion": np.array([[balloon.stiffness.torsion for balloon in balloons]]),
        "viscosity": np.array([[balloon.stiffness.viscosity for balloon in balloons]]),
        "yield_stretch": np.array([[balloon.stiffness.yield_stretch or NEVER_YIELDS for balloon in balloons]]),
        "mass": np.array([[balloon.mass for balloon in balloons]]),
        "helium": np.array([[balloon.helium for balloon in balloons]]),
        "damping": np.array([[balloon.damping for balloon in balloons]]),
        "keyframe_values": np.array([[[v for _, v in keys + keys[-1:] * (longest - len(keys))] for keys in keyframes]]),
        "initial_gas_amounts": np.array([[_or_nan(balloon.inflation.amount) for balloon in balloons]]),
        "initial_pressures": np.array([[balloon.inflation.start_pressure for balloon in balloons]]),
        "gamma": np.array([[balloon.inflation.gamma for balloon in balloons]]),
        "molar_mass": np.array([[balloon.inflation.molar_mass for balloon in balloons]]),
        "drag_coefficient": np.array([[balloon.drag_coefficient for balloon in balloons]]),
        "initial_balloon_positions": np.array([[balloon.position for balloon in balloons]]),
        "initial_sphere_positions": np.array([sphere.position for sphere in spheres]).reshape(1, -1, 3),
        "initial_sphere_velocities": np.array([sphere.velocity for sphere in spheres]).reshape(1, -1, 3),
        "sphere_mass": np.array([[sphere.mass for sphere in spheres]]),
        "sphere_radius": np.array([[sphere.radius for sphere in spheres]]),
        "sphere_penalty": np.array([[sphere.penalty for sphere in spheres]]),
        "string_anchor": np.array([string.anchor for string in strings]).reshape(1, -1, 3),
        "string_length": np.array([[_or_nan(string.length) for string in strings]]),
        "string_stiffness": np.array([[string.stiffness for string in strings]]),
        "gravity": np.array([scene.gravity]),
        "ground_height": np.array([ground.height]),
        "ground_friction": np.array([ground.friction]),
        "ground_restitution": np.array([ground.restitution]),
        "water_level": np.array([water.level]),
        "water_density": np.array([water.density]),
        "water_drag": np.array([water.drag]),
        "air_pressure": np.array([air.pressure]),
        "air_temperature": np.array([air.temperature]),
        "air_density": np.array([-1.0 if air.density is None else air.density]),
        "wind": np.array([air.wind]),
        "tube_conductance": np.array([[tube.conductance for tube in scene.tube]]),
    }


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def vary_parameters(parameters: Parameters, scene: Scene, world_count: int, vary: Vary) -> Parameters:
    """The parameters with a value for each world where `vary` has them.

    Raises:
        InputError: names the path, and the world whose value the scene's schema refuses; or what can vary.
    """
    places = _places(scene)
    varied = dict(parameters)
    for path, values in check_vary(scene, world_count, vary).items():
        for name, index in places[path]:
            if varied[name] is parameters[name]:
                varied[name] = np.repeat(parameters[name], world_count, axis=0)
            target = varied[name][(slice(None), *index)]
            target[...] = values.reshape(-1, *([1] * (target.ndim - 1)))
    return varied


def check_vary(scene: Scene, world_count: int, vary: Vary) -> dict[str, NDArray[np.float64]]:
    """The varied values as arrays of shape (world_count,), all of them fit for the scene.

    Raises:
        InputError: as `vary_parameters`.
    """
    places = _places(scene)
    checked = {}
    for path, given in vary.items():
        if path not in places:
            override_scene(scene, [(path, np.ravel(given).tolist()[0])])  # says so where there is no such path
            table = path.partition(".")[0]
            if table in SURROUNDINGS and not getattr(scene, table):
                raise InputError(f"{path}: cannot differ between worlds, the scene has no {table}")
            raise InputError(f"{path}: cannot differ between worlds; what can is {', '.join(_summary(places))}")
        checked[path] = _checked(scene, path, given, world_count)
    return checked


def require_changeable(scene: Scene, paths: Iterable[str]) -> None:
    """Make sure that values may change while the scene is simulated.

    Raises:
        InputError: names the path that may not.
    """
    places = _places(scene)
    for path in paths:
        named = [place for known, place in places.items() if known == path or known.startswith(f"{path}.")]
        at_start = any(name.startswith("initial_") for place in named for name, _ in place)
        if path not in METHODS and (at_start or not named):
            methods = ", ".join(METHODS)
            raise InputError(f"{path}: cannot change; what can is {methods}, and what may differ between worlds")


def _checked(scene: Scene, path: str, given: ArrayLike, world_count: int) -> NDArray[np.float64]:
    """The values of one path, each fit for the scene: bounds are intervals, so the extremes speak for all."""
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{path}: expected a number for each world (got {str(given)[:60]})") from None
    if values.shape != (world_count,):
        raise InputError(f"{path}: expected a value for each of {world_count} worlds (got shape {values.shape})")
    wild = ~np.isfinite(values)
    for world in [wild.argmax()] if wild.any() else [values.argmin(), values.argmax()]:
        try:
            override_scene(scene, [(path, float(values[world]))])
        except InputError as mistake:
            raise InputError(f"{mistake}, in world {world}") from None
    return values


def _places(scene: Scene) -> dict[str, list[Place]]:
    """By path: `balloon.0.mass` is one place, `balloon.mass` one for each balloon."""
    places: dict[str, list[Place]] = {}
    for path, place in _numbered_places(scene):
        places.setdefault(path, []).append(place)
        if _is_numbered(path):
            table, _, field = path.split(".", 2)
            places.setdefault(f"{table}.{field}", []).append(place)
    return places


def _numbered_places(scene: Scene) -> Iterator[tuple[str, Place]]:
    yield "gravity", ("gravity", ())
    yield "correction_limit", ("correction_limit", ())
    for table, fields in SURROUNDINGS.items():
        for field in fields if getattr(scene, table) else ():
            yield f"{table}.{field}", (f"{table}_{field}", ())
    for number, balloon in enumerate(scene.balloon):
        for field in ("mass", "helium", "damping", "drag_coefficient"):
            yield f"balloon.{number}.{field}", (field, (number,))
        for axis in range(3):
            yield f"balloon.{number}.position.{axis}", ("initial_balloon_positions", (number, axis))
        for kind, name in enumerate(KINDS):
            yield f"balloon.{number}.stiffness.{name}", ("stiffness", (number, kind))
        for field in ("torsion", "viscosity", "yield_stretch"):
            yield f"balloon.{number}.stiffness.{field}", (field, (number,))
        # As in overrides, a number takes the place of all keyframes, and a keyframe's value has a path of its own.
        field = balloon.inflation.keyframed
        yield f"balloon.{number}.inflation.{field}", ("keyframe_values", (number, slice(None)))
        if isinstance(getattr(balloon.inflation, field), list):
            for key in range(len(balloon.inflation.keyframes)):
                yield f"balloon.{number}.inflation.{field}.{key}.1", ("keyframe_values", (number, key))
        if balloon.inflation.kind == "gas":
            yield f"balloon.{number}.inflation.amount", ("initial_gas_amounts", (number,))
            yield f"balloon.{number}.inflation.start_pressure", ("initial_pressures", (number,))
            for field in ("gamma", "molar_mass"):
                yield f"balloon.{number}.inflation.{field}", (field, (number,))
    for number in range(len(scene.sphere)):
        for field in ("mass", "radius", "penalty"):
            yield f"sphere.{number}.{field}", (f"sphere_{field}", (number,))
        for axis in range(3):
            yield f"sphere.{number}.position.{axis}", ("initial_sphere_positions", (number, axis))
            yield f"sphere.{number}.velocity.{axis}", ("initial_sphere_velocities", (number, axis))
    for number in range(len(scene.string)):
        for field in ("length", "stiffness"):
            yield f"string.{number}.{field}", (f"string_{field}", (number,))
        for axis in range(3):
            yield f"string.{number}.anchor.{axis}", ("string_anchor", (number, axis))
    for number in range(len(scene.tube)):
        yield f"tube.{number}.conductance", ("tube_conductance", (number,))
    for field in ("pressure", "temperature", "density"):
        yield f"atmosphere.{field}", (f"air_{field}", ())
    for axis in range(3):
        yield f"atmosphere.wind.{axis}", ("wind", (axis,))


def _summary(places: Mapping[str, list[Place]]) -> list[str]:
    """The paths without the numbers of balloons, spheres, strings and tubes."""
    return [path for path in places if not _is_numbered(path)]


def _is_numbered(path: str) -> bool:
    return path.partition(".")[2].partition(".")[0].isdecimal()
