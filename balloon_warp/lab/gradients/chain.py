"""Chain rule from the numbers that kernels read to values at paths of a scene.

Chain rule from a path of a scene to the numbers that kernels read: how fast each grows with the path's value.

Derived parameters of a plan, such as a mass from a density or an amount of gas from a pressure, are smooth and in
double precision. So differences of two plans give their derivatives.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Columns, Parameter
from balloon_warp.model import Model, ModelPlan, State, Vary
from balloon_warp.model.obstacles import FRICTION, OF_BALLOONS, SAID
from balloon_warp.model.parameters import Place, is_numbered, parameters_at, places_of, rows_of, vary_parameters
from balloon_warp.model.plan import resolved_parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene
from balloon_warp.scene.load import frame_at, override_scene
from balloon_warp.scene.scene import Change
from balloon_warp.schedules.backward import (
    OF_STRINGS,
    POSITION,
    BackwardFrames,
    EachBackward,
    FixturesBackward,
    StringsBackward,
    bytes_of_each,
    bytes_of_fixtures,
)
from balloon_warp.schedules.backward_launched import Backward, LaunchedBackward
from balloon_warp.springs.build import build_membrane

Slopes = dict[str, NDArray[np.float64]]
"""Slopes of parameters by a value, by their names, shape (world_count, ...) as they are there"""
OF_CHANGE = re.compile(r"change\.(\d+)\.set\.(.+)")
"""Path of a value that a change sets"""


def first_frames(plan: ModelPlan) -> list[int]:
    """Return the frames with which spans begin."""
    return [0, *(change.frame for change in plan.due_changes if change.frame < plan.scene.frames)]


class KeptParameters:
    """Keep parameters that change, as they are in each span.

    Args:
        model: whose parameters change while it is simulated.
    """

    def __init__(self, plan: ModelPlan, model: Model):
        self._model, self._begins = model, first_frames(plan)
        names = {name for change in plan.due_changes for name in change.values}
        self._names = names | ({FRICTION} if not names.isdisjoint(SAID) else set())
        self._kept: list[dict[str, NDArray]] = []

    def note(self, frame: int) -> None:
        """Keep the values of a simulated frame that begins a span."""
        for _ in range(self._begins.count(frame)):
            self._kept.append({name: self._model.parameters[name].numpy().copy() for name in self._names})

    def span_of(self, frame: int) -> int:
        """Return the span of a frame."""
        return max(sum(begin <= frame for begin in self._begins) - 1, 0)

    def of_span(self, span: int) -> dict[str, NDArray]:
        """Return the parameters of a span that change at any time, by their names."""
        return self._kept[span]

    def bring_back(self, span: int) -> None:
        """Set parameters to their values in a span."""
        for name, values in self._kept[span].items():
            self._model.parameters[name].assign(values)


def slopes_of_spans(plan: ModelPlan, slopes: Slopes) -> tuple[Slopes, ...]:
    """Return the slopes in each span by a value that counts from the start, until changes set another one."""
    spans = [slopes]
    for frame in first_frames(plan)[1:]:
        spans.append(_without(spans[-1], _written(plan, frame, -1)))
    return tuple(spans)


def slopes_of_change(plan: ModelPlan, path: str) -> tuple[Slopes, ...]:
    """Return the slopes in each span by a value that a change sets, until others set another one.

    Raises:
        InputError: there is no such change, or it sets no number there.
    """
    number, inner = _parts_of(plan, path)
    at = frame_at(plan.scene, plan.scene.change[number].time)
    begins, spans = first_frames(plan), list[Slopes]()
    slopes: Slopes = {}
    for span, frame in enumerate(begins):
        if span and frame == at:
            slopes = {
                name: np.repeat(mask[None].astype(np.float64), plan.world_count, axis=0)
                for name, mask in _masks(plan, [inner]).items()
            }
            slopes = _without(slopes, _written(plan, frame, number))
        elif span:
            slopes = _without(slopes, _written(plan, frame, -1))
        spans.append(slopes)
    return tuple(spans)


def _parts_of(plan: ModelPlan, path: str) -> tuple[int, str]:
    """Return the number of a change, and the path that it sets.

    Raises:
        InputError: there is no such change, or it sets no number there.
    """
    told, changes = OF_CHANGE.fullmatch(path), plan.scene.change
    if not told or int(told[1]) >= len(changes):
        raise InputError(f"{path}: the scene has {len(changes)} changes; expected change.NUMBER.set.PATH, from 0")
    number, inner = int(told[1]), told[2]
    value = changes[number].set.get(inner)
    if value is None:
        vector, _, axis = inner.rpartition(".")
        value = changes[number].set.get(vector)
        value = value[int(axis)] if isinstance(value, list | tuple) and axis.isdecimal() else value
    if isinstance(value, bool) or not isinstance(value, int | float):
        paths = ", ".join(changes[number].set)
        raise InputError(f"{path}: change {number} sets no number there; expected one of what it sets, {paths}")
    return number, inner


def _written(plan: ModelPlan, frame: int, after: int) -> dict[str, NDArray[np.bool_]]:
    """Return the entries of parameters that changes set at a frame, those of a number and before left out."""
    masks: dict[str, NDArray[np.bool_]] = {}
    if after < 0:
        (due,) = (change for change in plan.due_changes if change.frame == frame)
        masks = {name: which.copy() for name, (which, _) in due.values.items()}
    for name, mask in _masks(plan, list(_paths_set(plan.scene.change, plan, frame, after))).items():
        masks[name] = masks[name] | mask if name in masks else mask
    return masks


def _paths_set(changes: Sequence[Change], plan: ModelPlan, frame: int, after: int) -> Iterator[str]:
    """Yield the paths that changes set at a frame, those of a number and before left out."""
    for number, change in enumerate(changes):
        if number > after and frame_at(plan.scene, change.time) == frame:
            yield from change.set


def _masks(plan: ModelPlan, paths: Sequence[str]) -> dict[str, NDArray[np.bool_]]:
    """Return the entries of parameters at paths, or in the tables or vectors there."""
    rows: Sequence[Parameter] = rows_of(plan.laws)
    places: Mapping[str, list[Place]] = places_of(plan.scene, rows)
    masks: dict[str, NDArray[np.bool_]] = {}
    for path in paths:
        for known, found in places.items():
            for name, index in found if known == path or known.startswith(f"{path}.") else ():
                if name in plan.parameters:
                    masks.setdefault(name, np.zeros(plan.parameters[name].shape[1:], dtype=bool))[index] = True
    return masks


def _without(slopes: Slopes, written: Mapping[str, NDArray[np.bool_]]) -> Slopes:
    """Return slopes without those of entries that have been written."""
    left = {name: np.where(written[name], 0.0, array) if name in written else array for name, array in slopes.items()}
    return {name: array for name, array in left.items() if array.any()}


Values = NDArray[np.float64]
OF_SPRINGS = ("rest_lengths", "spring_constants")
KNOWN = (*OF_SPRINGS, "thicknesses", "rest_points")
"""Names of values of each spring, each face, and each vertex of a shape at rest"""


def require_each(plan: ModelPlan, names: Sequence[str]) -> None:
    """Make sure that a scene has the springs, membranes or rest points by whose values is derived.

    Raises:
        InputError: it has not.
    """
    if isinstance(names, str) or not names:
        raise InputError(f"each: expected a list of some of {', '.join(KNOWN)} (got {names!r})")
    for name in names:
        if name not in KNOWN:
            raise InputError(f"each: expected some of {', '.join(KNOWN)} (got {name!r})")
        if name in OF_SPRINGS and not any(shape.springs.count for shape in plan.shapes):
            raise InputError(f"each: {name}: the scene has no springs")
        if name == "thicknesses" and not any(shape.membrane.count for shape in plan.shapes):
            raise InputError(f"each: {name}: the scene has no rubber or film, which has a thickness")
        for shape in plan.shapes if name == "rest_points" else ():
            if not _rests_by_points(shape):
                raise InputError(
                    f"each: {name}: springs of {shape.name} have lengths at rest of their own; expected rest_lengths"
                )


def by_each(
    plan: ModelPlan, model: Model, found: tuple[Values, Values], names: Sequence[str]
) -> dict[str, list[Values]]:
    """Return derivatives by name, an array for each balloon, worlds first.

    Args:
        found: bars of springs and triangles, see `EachBackward.found`.
    """
    of_springs = _by_balloon(found[0], [shape.springs.count for shape in plan.shapes])
    of_triangles = _by_balloon(found[1], [shape.membrane.count for shape in plan.shapes])
    thickness = np.asarray(model.parameters["thickness"].numpy(), dtype=np.float64)
    makers: dict[str, Callable[[int, BalloonShape], Values]] = {
        "rest_lengths": lambda number, shape: of_springs[number][..., 0],
        "spring_constants": lambda number, shape: of_springs[number][..., 1],
        "thicknesses": lambda number, shape: _by_thicknesses(shape, of_triangles[number], thickness[:, number]),
        "rest_points": lambda number, shape: (
            _by_points_of_springs(shape, of_springs[number][..., 0]) + _by_points_of_film(shape, of_triangles[number])
        ),
    }
    return {name: [makers[name](*each) for each in enumerate(plan.shapes)] for name in names}


def _by_balloon(array: Values, counts: Sequence[int]) -> list[Values]:
    return [array[:, begin:end] for begin, end in pairwise(accumulate(counts, initial=0))]


def _rests_by_points(shape: BalloonShape) -> bool:
    """Return whether springs are at rest as long as the vertices of the shape at rest are apart."""
    springs, resting = shape.springs, shape.resting.points
    return not springs.count or np.allclose(springs.resting_at(resting).rest_lengths, springs.rest_lengths, rtol=1e-9)


def _by_thicknesses(shape: BalloonShape, bars: Values, thickness: Values) -> Values:
    """Return derivatives by the thickness of each face, shape (W, face_count), of those by the areas of triangles."""
    if not shape.membrane.count:
        return np.zeros((len(bars), shape.mesh.face_count))
    areas = build_membrane(shape.resting).areas  # without weights, which are part of a thickness
    return _gathered(bars[..., 3] * areas / thickness[:, None], shape.membrane.faces, shape.mesh.face_count)


def _by_points_of_springs(shape: BalloonShape, bars: Values) -> Values:
    """Return derivatives by the shape at rest, shape (W, n, 3), of those by rest lengths."""
    ends, points = shape.springs.pairs, shape.resting.points
    apart = points[ends[:, 1]] - points[ends[:, 0]]
    lengths = np.linalg.norm(apart, axis=1, keepdims=True)
    along = bars[..., None] * np.divide(apart, lengths, out=np.zeros_like(apart), where=lengths > 0.0)
    count = shape.resting.vertex_count
    return _gathered(along, ends[:, 1], count) - _gathered(along, ends[:, 0], count)


def _by_points_of_film(shape: BalloonShape, bars: Values) -> Values:
    """Return derivatives by the shape at rest, shape (W, n, 3), of those by each triangle's metric C and area A.

    C = (E^T E)^-1 for edges E as columns, and A is half the root of det E^T E. So with the bars' symmetric matrix B,
    E's bar is -2 E C B C + A bar(A) E C.
    """
    count = shape.resting.vertex_count
    if not shape.membrane.count:
        return np.zeros((len(bars), count, 3))
    rests, edges = shape.membrane.rests, shape.membrane.edges
    squares, halves = np.array([[0, 1], [1, 2]]), np.array([[1.0, 0.5], [0.5, 1.0]])
    metric, by_metric = rests[:, squares], bars[..., squares] * halves
    inner = -2.0 * metric @ by_metric @ metric + (bars[..., 3] * rests[:, 3])[..., None, None] * metric
    by_edges = inner @ edges * (1.0 - shape.membrane.cut)  # symmetric matrices times rows of edges
    corners = build_membrane(shape.resting).corners  # of panels, before they are sewn
    by_corners = (-by_edges.sum(axis=2), by_edges[..., 0, :], by_edges[..., 1, :])
    return sum(
        (_gathered(part, corners[:, column], count) for column, part in enumerate(by_corners)),
        start=np.zeros((len(bars), count, 3)),
    )


def _gathered(values: Values, places: NDArray[np.integer], count: int) -> Values:
    """Return the sums of values at each place, shape (W, count, ...), of values of shape (W, m, ...)."""
    totals = np.zeros((count, len(values), *values.shape[2:]))
    np.add.at(totals, places, values.swapaxes(0, 1))
    return totals.swapaxes(0, 1)


KEYFRAMES = "obstacle_keyframes"
"""Name of the places of obstacles at their keyframes, shape (W, N, keyframe_count, 3), as bars and slopes have them"""
OF_MOTION = re.compile(r"obstacle\.(\d+)\.motion\.(\d+)\.1\.([012])")
"""Path of a coordinate of an obstacle's place at a keyframe"""
FIRST = 1
"""Number of the first obstacle among all things"""


def is_of_motion(path: str) -> bool:
    """Return whether a path leads to the motion of an obstacle."""
    return path.startswith("obstacle.") and path.split(".")[2:3] == ["motion"]


def slopes_of_motion(plan: ModelPlan, path: str) -> Slopes:
    """Return the slopes by a coordinate of an obstacle's place at a keyframe.

    Raises:
        InputError: there is no such keyframe, or the path leads to no coordinate of a place.
    """
    told, obstacles = OF_MOTION.fullmatch(path), plan.scene.obstacle
    number = int(each) if (each := path.split(".")[1]).isdecimal() else len(obstacles)
    if number >= len(obstacles):
        raise InputError(f"{path}: the scene has {len(obstacles)} obstacles; expected obstacle.NUMBER, from 0")
    count = len(obstacles[number].motion or ())
    if not told or int(told[2]) >= count:
        raise InputError(
            f"{path}: obstacle {number} has {count} keyframes; expected obstacle.{number}.motion.KEYFRAME.1.AXIS, from "
            "0, which is a coordinate of its place then"
        )
    slopes = np.zeros((plan.world_count, len(obstacles), _most_keyframes(plan.scene), 3))
    slopes[:, number, int(told[2]), int(told[3])] = 1.0
    return {KEYFRAMES: slopes}


def _most_keyframes(scene: Scene) -> int:
    return max((len(obstacle.motion or ()) for obstacle in scene.obstacle), default=0)


def is_on_obstacles(plan: ModelPlan, slopes: Values) -> bool:
    """Return whether any coefficient of a balloon on an obstacle grows, of those of all pairs of things."""
    last = FIRST + len(plan.scene.obstacle)
    return bool(slopes[:, slopes.shape[1] - len(plan.shapes) :, FIRST:last].any())


class ByObstacles:
    """Collect the bars of obstacles, frame by frame.

    Args:
        backward: of contacts with obstacles, which finds them.
    """

    def __init__(self, plan: ModelPlan, model: Model, backward: FixturesBackward):
        self._scene, self._model, self._backward = plan.scene, model, backward
        self._keyframes = np.zeros((model.world_count, len(model.obstacles), _most_keyframes(plan.scene), 3))
        self._positions = np.zeros((model.world_count, len(model.obstacles), 3))
        self._frictions = np.zeros((model.world_count, model.balloon_count, len(model.obstacles)))

    def note(self, frame: int) -> None:
        """Add the bars of a frame that has run backwards."""
        places, frictions = self._backward.of_frame()
        self._positions += places.sum(axis=2)
        self._frictions += frictions
        for number, obstacle in enumerate(self._scene.obstacle):
            if obstacle.motion:
                times = [keyframe[0] for keyframe in obstacle.motion]
                for end in (0, 1):
                    time = (frame + end) * self._model.frame_seconds
                    weights = np.array([np.interp(time, times, unit) for unit in np.eye(len(times))])
                    self._keyframes[:, number, : len(times)] += weights[:, None] * places[:, number, None, end]

    def taken_numbers(self) -> dict[str, Values]:
        """Return the bars since they were last taken, by the names of parameters."""
        of_pairs = np.zeros((self._model.world_count, *self._model.parameters[FRICTION].shape[1:]))
        of_pairs[:, -self._model.balloon_count :, FIRST : FIRST + len(self._model.obstacles)] = self._frictions
        taken = {POSITION: self._positions, KEYFRAMES: self._keyframes, FRICTION: of_pairs}
        self._positions, self._keyframes, self._frictions = (
            np.zeros_like(array) for array in (self._positions, self._keyframes, self._frictions)
        )
        return taken


REACH = 1e-4
"""Half of the difference, over the value, or over 1 where that is 0: its error is a hundred millionth"""


@dataclass(frozen=True)
class Chain:
    """Hold the slopes of a plan's parameters by the value at one path."""

    path: str
    spans: tuple[Slopes, ...]
    """Slopes by parameter name, shape (world_count, ...) as in the plan, between changes; none where it is 0"""

    @property
    def slopes(self) -> Slopes:
        """Slopes at the start."""
        return self.spans[0]


def chains_of(plan: ModelPlan, paths: Sequence[str], vary: Vary) -> list[Chain]:
    """Return the slopes by each path.

    Raises:
        InputError: a path is not there, cannot be derived by, or is of several values.
    """
    if isinstance(paths, str) or not paths:
        raise InputError(f"of: expected a list of paths, such as balloon.inflation.amount (got {str(paths)!r})")
    return [Chain(path, _spans(plan, path, vary)) for path in dict.fromkeys(paths)]


def _spans(plan: ModelPlan, path: str, vary: Vary) -> tuple[Slopes, ...]:
    if path.startswith("change."):
        return slopes_of_change(plan, path)
    if is_of_motion(path):
        return slopes_of_spans(plan, slopes_of_motion(plan, path))
    return slopes_of_spans(plan, _slopes(plan, path, vary))


def _slopes(plan: ModelPlan, path: str, vary: Vary) -> Slopes:
    value = value_in_worlds(plan, path, vary)
    reach = REACH * np.where(value == 0.0, 1.0, np.abs(value))
    sides = {}
    for sign in (1.0, -1.0, 2.0):
        try:
            sides[sign] = resolved_parameters(plan, {**vary, path: value + sign * reach})
        except InputError:
            if sign == 1.0:
                raise
        if len(sides) == 2:
            break
    if len(sides) < 2:
        raise InputError(f"{path}: cannot be derived by, since its value can neither grow nor fall")
    here = resolved_parameters(plan, {**vary, path: value})
    slopes = {}
    for name, more in sides[1.0].items():
        if -1.0 in sides:
            change = more - sides[-1.0][name]
            slope = change / 2.0
        else:  # at a bound
            change = more - here[name]
            slope = 2.0 * change - (sides[2.0][name] - here[name]) / 2.0
        if np.isfinite(change).all() and change.any():
            each = np.broadcast_to(slope, (plan.world_count, *slope.shape[1:]))
            slopes[name] = each / reach.reshape(-1, *([1] * (each.ndim - 1)))
    return slopes


def value_in_worlds(plan: ModelPlan, path: str, vary: Vary) -> NDArray[np.float64]:
    """Return the value at a path in each world, shape (world_count,).

    Raises:
        InputError: the path leads to no number, to several, or to one that the scene leaves open.
    """
    rows = rows_of(plan.laws)
    said = vary_parameters(parameters_at(plan.scene, rows, 0), plan.scene, rows, plan.world_count, vary)
    places = places_of(plan.scene, rows)
    if path not in places:
        _refuse(plan, path)
    columns = []
    for name, index in places[path]:
        values = np.broadcast_to(said[name], (plan.world_count, *said[name].shape[1:]))[(slice(None), *index)]
        columns += list(values.reshape(plan.world_count, -1).T)
    if any((column != columns[0]).any() and not np.isnan(column).all() for column in columns):
        listed = ", ".join(f"{column[0]:g}" for column in columns[:4])
        one = "one of them" if is_numbered(path) else f"the path of one of them, such as {_numbered(path)}"
        raise InputError(f"{path}: stands for several values, {listed}; expected {one}")
    if np.isnan(columns[0]).any():
        raise InputError(f"{path}: the scene leaves it open; expected a value there, or in `vary`")
    return columns[0]


def _refuse(plan: ModelPlan, path: str) -> NoReturn:
    """Raise the error of a path that leads to no parameter."""
    try:
        override_scene(plan.scene, [(path, 1.0)])
    except InputError as mistake:
        if "unknown" in str(mistake) or "there is no" in str(mistake):
            raise
    raise InputError(f"{path}: cannot be derived by; expected the path of a number, such as balloon.mass")


def _numbered(path: str) -> str:
    table, _, field = path.partition(".")
    return f"{table}.0.{field}"


def product(slopes: NDArray[np.float64], bars: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum over all numbers of a parameter of slope times bar, shape (world_count,)."""
    return np.array([float(np.dot(a.ravel(), b.ravel())) for a, b in zip(slopes, bars, strict=True)])


def names_in(chains: Sequence[Chain]) -> Mapping[str, Any]:
    """Return the names of all parameters that change."""
    return dict.fromkeys(name for chain in chains for slopes in chain.spans for name in slopes)


EACH, STRINGS, OBSTACLES = "each part", "strings", "obstacles"


def wanted_of(plan: ModelPlan, chains: Sequence[Chain], each: Sequence[str] = ()) -> dict[str, str]:
    """Return the derivatives that only launches find, each with the path or name that asks for it.

    Raises:
        InputError: the scene has none of a kind in `each`.
    """
    wanted = {}
    if each:
        require_each(plan, each)
        wanted[EACH] = f"each: {each[0]}"
    for chain in chains:
        for name, slopes in (item for span in chain.spans for item in span.items()):
            if name in OF_STRINGS:
                wanted[STRINGS] = chain.path
            if name in (POSITION, KEYFRAMES) or (name == FRICTION and is_on_obstacles(plan, slopes)):
                wanted[OBSTACLES] = chain.path
    return wanted


def schedule_for(wanted: dict[str, str], schedule: str) -> str:
    """Return the schedule in which frames run backwards.

    Raises:
        InputError: wanted derivatives need launches, and another schedule is asked for.
    """
    if wanted and schedule == "block":
        path = next(iter(wanted.values()))
        raise InputError(f"{path}: is derived by launches; expected the schedule launched or auto (got 'block')")
    return "launched" if wanted else schedule


def bytes_by_launches(model: Model, wanted: Collection[str]) -> int:
    """Return the device memory that this takes of each world."""
    of_obstacles = bytes_of_fixtures(model) if OBSTACLES in wanted else 0
    return (bytes_of_each(model) if EACH in wanted else 0) + of_obstacles


class ByLaunches:
    """Have frames that run backwards find wanted derivatives, and collect these.

    Args:
        backward: of launches, if anything is wanted.
    """

    def __init__(self, plan: ModelPlan, model: Model, backward: BackwardFrames, wanted: Collection[str]):
        self._obstacles: ByObstacles | None = None
        self._strings: StringsBackward | None = None
        self._each: EachBackward | None = None
        if not wanted:
            return
        assert isinstance(backward, LaunchedBackward)
        features, tables, arrays = backward.step.features, backward.tables, backward.arrays
        if EACH in wanted:
            self._each = EachBackward(model, features, tables, arrays)
            backward.parts.append(self._each)
        if STRINGS in wanted:
            self._strings = StringsBackward(model, features, tables, arrays)
            backward.parts.append(self._strings)
        if OBSTACLES in wanted:
            backward.fixtures = FixturesBackward(model, tables, backward.working)
            self._obstacles = ByObstacles(plan, model, backward.fixtures)

    def note(self, frame: int) -> None:
        """Collect the derivatives of a frame that has run backwards."""
        if self._obstacles:
            self._obstacles.note(frame)

    def taken_numbers(self) -> dict[str, Values]:
        """Return the bars of strings and obstacles since they were last taken, by the names of parameters."""
        of_strings = self._strings.taken_numbers() if self._strings else {}
        return of_strings | (self._obstacles.taken_numbers() if self._obstacles else {})

    def of_each(self) -> tuple[Values, Values]:
        """Return the bars of each spring and each triangle, see `EachBackward.found`."""
        assert self._each
        return self._each.found()


def made_backward(
    plan: ModelPlan, model: Model, state: State, runs_back: Backward, columns: Sequence[int], wanted: Collection[str]
) -> tuple[BackwardFrames, ByLaunches]:
    """Return the runner of frames backwards, with lists of contacts as long as they are forwards."""
    backward = runs_back(model, state, columns)
    return backward, ByLaunches(plan, model, backward, wanted)


ON_GROUND = 0
"""Number of the ground among all things"""


def keyframe_weights(times: Values, time: float) -> Values:
    """Return the part of each keyframe in the value at a time, shape (keyframe_count,), as kernels interpolate."""
    weights = np.zeros(len(times))
    weights[0] = 1.0
    for key, (begin, end) in enumerate(pairwise(times)):
        if time > begin and end > begin:
            blend = min((time - begin) / (end - begin), 1.0)
            weights[:] = 0.0
            weights[key], weights[key + 1] = 1.0 - blend, blend
    return weights


def by_keyframes(model: Model, frame: int, keyed: Values) -> Values:
    """Return derivatives by keyframe values of one frame, shape (W, B, keyframe_count).

    Args:
        keyed: sums of the derivatives by the keyed value over substeps, and of those times the time in the frame [s],
            shape (W, B, 2).
    """
    found = []
    for number, times in enumerate(np.asarray(model.keyframe_times.numpy(), dtype=np.float64)):
        begin = frame * model.frame_seconds
        first, last = (keyframe_weights(times, time) for time in (begin, begin + model.frame_seconds))
        late = keyed[:, number, 1] / model.frame_seconds
        found.append(np.outer(keyed[:, number, 0] - late, first) + np.outer(late, last))
    return np.stack(found, axis=1)


def by_numbers(columns: Columns, wanted: tuple[int, ...], totals: Values) -> dict[str, Values]:
    """Return derivatives by the parameters of laws.

    Args:
        wanted: columns that were derived by.
        totals: shape (W, B, count of them).
    """
    bars: dict[str, Values] = {}
    places = {column: number for number, column in enumerate(wanted)}
    for row in columns.rows:
        own = [places.get(columns.places[row.name] + each) for each in range(row.size)]
        numbers = [place for place in own if place is not None]
        if len(numbers) < row.size:
            continue
        array = totals[:, :, numbers] if row.size > 1 else totals[:, :, numbers[0]]
        bars[row.name] = array if row in columns.balloon else array.sum(axis=1)
    return bars


def columns_of_names(columns: Columns, names: Any) -> tuple[int, ...]:
    """Return the columns of those parameters of laws that are named; friction on the ground has that of balloons."""
    asked = {*names, *(OF_BALLOONS for name in names if name == FRICTION)}
    return tuple(
        columns.places[row.name] + each for row in columns.rows if row.name in asked for each in range(row.size)
    )


def by_friction(model: Model, bars: dict[str, Values]) -> dict[str, Values]:
    """Return derivatives by the coefficients of pairs, of which those of balloons and the ground are known."""
    if OF_BALLOONS not in bars:
        return {}
    of_pairs = np.zeros((model.world_count, *model.parameters[FRICTION].shape[1:]))
    of_pairs[:, -model.balloon_count :, ON_GROUND] = bars.pop(OF_BALLOONS)
    return {FRICTION: of_pairs}


def taken_numbers(model: Model, backward: BackwardFrames, beside: ByLaunches) -> dict[str, Values]:
    """Return derivatives by the numbers of laws, spheres and contacts since they were last taken.

    Args:
        beside: derivatives that only launches find.
    """
    totals = np.asarray(backward.bars.number_totals.numpy(), dtype=np.float64).copy()
    backward.bars.number_totals.zero_()
    of_spheres = backward.spheres.taken_numbers() if backward.spheres else {}
    of_tubes = backward.tubes.taken_numbers() if backward.tubes else {}
    numbers = by_numbers(model.columns, backward.columns, totals)
    of_touch = backward.touch.taken_numbers() if backward.touch else {}
    of_pairs, of_more = by_friction(model, numbers), beside.taken_numbers()
    frictions = [bars[FRICTION] for bars in (of_pairs, of_touch, of_spheres, of_more) if FRICTION in bars]
    found = {**numbers, **of_spheres, **of_touch, **of_tubes, **of_more}
    return found | ({FRICTION: sum(frictions[1:], start=frictions[0])} if frictions else {})


def by_start(plan: ModelPlan, model: Model, points: Values, velocities: Values) -> dict[str, Values]:
    """Return derivatives by where balloons start, and how fast, as `place_balloons` places them.

    Args:
        points: derivatives by the particles' places at the start, shape (W, P, 3).
        velocities: by their velocities.
    """
    worlds, count = len(points), len(plan.shapes)
    names = ("shifts", "centers", "velocities", "spins")
    bars: dict[str, Values] = {f"initial_{name}": np.zeros((worlds, count, 3)) for name in names}
    bars["initial_turns"] = np.zeros((worlds, count, 3, 3))
    origins = np.asarray(model.balloon_origins.numpy(), dtype=np.float64)
    for number, shape in enumerate(plan.shapes):
        own = slice(*model.particle_offsets[number : number + 2])
        arms = shape.mesh.points - origins[number]
        free = (shape.mass_share > 0.0)[:, None]

        def value(name: str, of: int = number) -> Values:
            return np.broadcast_to(plan.parameters[name], (worlds, *plan.parameters[name].shape[1:]))[:, of]

        for world in range(worlds):
            turn, shift, center, spin = (
                value(f"initial_{name}")[world] for name in ("turns", "shifts", "centers", "spins")
            )
            by_velocity = velocities[world, own] * free
            levers = shape.mesh.points + arms @ turn.T + shift - center
            by_lever = np.cross(by_velocity, spin)
            by_place = points[world, own] + by_lever
            bars["initial_shifts"][world, number] = by_place.sum(axis=0)
            bars["initial_centers"][world, number] = -by_lever.sum(axis=0)
            bars["initial_turns"][world, number] = by_place.T @ arms
            bars["initial_velocities"][world, number] = by_velocity.sum(axis=0)
            bars["initial_spins"][world, number] = np.cross(levers, by_velocity).sum(axis=0)
    return bars
