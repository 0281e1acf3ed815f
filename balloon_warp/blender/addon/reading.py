"""Reading of a Blender scene for a bake: evaluated meshes, and motion from frame to frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.types import Context, Depsgraph, Mesh, Modifier, Object, PropertyGroup, Scene

from . import modifiers, properties
from .request import RIGID, RefusedError, Snapshot, Thing, in_world, is_rigid

PINNED = 0.5
"""Weight from which on a vertex of the pin group is pinned"""
LEVELS = {"SUBSURF": "simplify_subdivision", "MULTIRES": "simplify_subdivision"}
"""Kinds of modifiers that have levels, and what limits these in a scene that is simplified"""


@dataclass(frozen=True)
class Part:
    """An object that takes part, or an instance of one, in one frame."""

    key: tuple[Any, ...]
    """Identity in all frames: the name of an object, with numbers if that has instances"""
    name: str
    original: Object
    evaluated: Object
    """The object as Blender evaluates it; of an instance it lasts while `_parts_of` is at it"""
    place: np.ndarray
    """Matrix from its own axes to the world's, shape (4, 4)"""


def read_scene(context: Context) -> Snapshot:
    """Read all that takes part, from the first frame to the last; the scene is left as it was.

    Raises:
        RefusedError: something cannot be baked; it names the object.
    """
    scene = context.scene
    if scene.frame_end <= scene.frame_start:
        raise RefusedError(f"{scene.name}: its frame range ends before it begins; expected two frames or more")
    taking = _objects_of(context)
    with _as_it_was(scene), _without_caches(taking):
        return _snapshot(context, taking)


def _objects_of(context: Context) -> list[Object]:
    """Return the objects of a scene that take part, balloons first.

    Raises:
        RefusedError: there is no balloon, or one cannot be baked.
    """
    scene = context.scene
    taking = [thing for thing in scene.objects if properties.of(thing).role != "NONE" and thing.type == "MESH"]
    taking.sort(key=lambda thing: properties.of(thing).role != "BALLOON")
    if not taking or properties.of(taking[0]).role != "BALLOON":
        raise RefusedError(f"{scene.name}: has no balloon; select a mesh and press Inflate")
    for thing in taking:
        _require_able(scene, thing)
    return taking


def _require_able(scene: Scene, thing: Object) -> None:
    if thing.mode == "EDIT":
        raise RefusedError(f"{thing.name}: is in Edit Mode; expected Object Mode")
    if properties.of(thing).role == "OBSTACLE":
        return
    if not thing.is_editable:
        raise RefusedError(f"{thing.name}: is linked from another file; expected a library override of it")
    for each in modifiers.above(thing):
        if _shown(scene, each, rendered=False) != _shown(scene, each, rendered=True):
            raise RefusedError(
                f"{thing.name}: its modifier {each.name}, above Balloon, makes another mesh in renders than in the "
                "viewport; expected the same levels in both"
            )


def _shown(scene: Scene, modifier: Modifier, rendered: bool) -> tuple[bool, int]:
    """Return whether a modifier is there in the viewport, or in renders, and its levels."""
    if not (modifier.show_render if rendered else modifier.show_viewport):
        return False, 0
    if modifier.type not in LEVELS:
        return True, 0
    levels = modifier.render_levels if rendered else modifier.levels
    limit = f"{LEVELS[modifier.type]}_render" if rendered else LEVELS[modifier.type]
    return True, min(levels, getattr(scene.render, limit)) if scene.render.use_simplify else levels


@contextmanager
def _as_it_was(scene: Scene) -> Iterator[None]:
    """Go back to the current frame in the end."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=subframe)


@contextmanager
def _without_caches(things: list[Object]) -> Iterator[None]:
    """Switch off the modifiers of a bake, and those below them."""
    below = [each for thing in things for each in modifiers.from_cache_on(thing)]
    shown = [(each, each.show_viewport) for each in below]
    try:
        for each in below:
            each.show_viewport = False
        yield
    finally:
        for each, show in shown:
            each.show_viewport = show


def _snapshot(context: Context, taking: list[Object]) -> Snapshot:
    scene, render = context.scene, context.scene.render
    scene.frame_set(scene.frame_start)
    graph = context.evaluated_depsgraph_get()
    there = [each for each in taking if each.evaluated_get(graph).is_evaluated]  # also what is hidden by its eye alone
    parts = [(part, _read(part, graph)) for part in _parts_of(graph, there)]
    things = {part.key: thing for part, thing in parts if len(thing.counts)}
    for part, thing in parts:
        if part.key[0] not in {key[0] for key in things}:  # nor does it scatter instances
            raise RefusedError(f"{thing.name}: has no faces; expected a mesh with a surface")
    units = scene.unit_settings
    snapshot = Snapshot(
        things=list(things.values()),
        first=scene.frame_start,
        frames=scene.frame_end - scene.frame_start,
        frames_per_second=render.fps / render.fps_base,
        meters=1.0 if units.system == "NONE" else units.scale_length,
        gravities=_gravity(scene)[None],
        settings=_values(properties.of(scene)),
        winds=_wind(scene, graph)[None],
        remarks=_left_out(scene),
    )
    if _moves(scene, _names_of(scene, [part for part, _ in parts])):
        _follow(context, there, things, snapshot)
    return snapshot


def _parts_of(graph: Depsgraph, taking: list[Object], instanced: bool = True) -> Iterator[Part]:
    """Iterate over objects, and instances of obstacles, as they are in a frame.

    Args:
        instanced: whether instances are looked for.

    Raises:
        RefusedError: a balloon or a body is there as an instance alone.
    """
    for thing in taking:
        evaluated = thing.evaluated_get(graph)
        yield Part((thing.name_full,), thing.name, thing, evaluated, np.array(evaluated.matrix_world, np.float64))
    for each in graph.object_instances if instanced else ():
        if not each.is_instance or each.object.type != "MESH":
            continue
        original = each.object.original
        role = properties.of(original).role
        if role in ("BALLOON", "BODY") and original not in taking:
            raise RefusedError(
                f"{original.name}: is an instance alone; expected an object: Object, Apply, Make Instances Real"
            )
        if role == "OBSTACLE":
            name, place = f"{original.name} of {each.parent.name}", np.array(each.matrix_world, np.float64)
            yield Part((each.parent.original.name_full, *each.persistent_id), name, original, each.object, place)


def _read(part: Part, graph: Depsgraph) -> Thing:
    """Read a part as it is at the start."""
    mesh = part.evaluated.to_mesh()
    try:
        points = _points(mesh)
        counts, corners = np.empty(len(mesh.polygons), np.int32), np.empty(len(mesh.loops), np.int32)
        mesh.polygons.foreach_get("loop_total", counts)
        mesh.loops.foreach_get("vertex_index", corners)
        pinned = _pinned(part.original, mesh)
    finally:
        part.evaluated.to_mesh_clear()
    _require_size(part.name, part.place)
    settings = _values(properties.of(part.original))
    anchor = settings.pop("string")
    return Thing(
        name=part.name,
        settings=settings,
        points=points,
        counts=counts,
        corners=corners,
        places=part.place[None],
        pinned=pinned,
        paths=in_world(points[pinned], part.place)[None],
        amounts=[settings[properties.amount_of(settings["inflate"])]],
        anchors=_place_of(anchor, graph)[None] if anchor else None,
    )


def _pinned(original: Object, mesh: Mesh) -> np.ndarray:
    """Return the vertices of a balloon's pin group."""
    settings = properties.of(original)
    if settings.role != "BALLOON" or not (name := settings.pinned):
        return np.zeros(0, np.int64)
    if name not in original.vertex_groups:
        raise RefusedError(f"{original.name}: has no vertex group {name}; expected the name of its pin group")
    group = original.vertex_groups[name].index
    weights = [sum(each.weight for each in vertex.groups if each.group == group) for vertex in mesh.vertices]
    return np.flatnonzero(np.array(weights) >= PINNED)


def _values(group: PropertyGroup) -> dict[str, Any]:
    """Return the values of a panel's properties by their names."""
    return {name: getattr(group, name) for name in group.__annotations__}


def _points(mesh: Mesh) -> np.ndarray:
    """Return the points of a mesh in its own axes, shape (n, 3)."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)


def _gravity(scene: Scene) -> np.ndarray:
    """Return the downward acceleration, shape ().

    Raises:
        RefusedError: it is not downward.
    """
    gravity = np.array(scene.gravity) if scene.use_gravity else np.zeros(3)
    if np.abs(gravity[:2]).max() > 1e-6:
        raise RefusedError(f"{scene.name}: its gravity has a part along X or Y; expected one along Z")
    return -gravity[2]


def _wind(scene: Scene, graph: Depsgraph) -> np.ndarray:
    """Return the sum of the wind force fields: their strengths, along their own Z axes [m/s]."""
    total = np.zeros(3)
    for each in scene.objects:
        if _is_wind(each):
            evaluated = each.evaluated_get(graph)
            axis = np.array(evaluated.matrix_world, np.float64)[:3, 2]
            total += evaluated.field.strength * axis / np.linalg.norm(axis)
    return total


def _is_wind(thing: Object) -> bool:
    """Return whether an object is a wind that blows."""
    return bool(thing.field) and thing.field.type == "WIND" and not thing.hide_viewport


def _left_out(scene: Scene) -> list[str]:
    """Return sentences on force fields that a bake leaves out, or takes for simpler ones."""
    remarks = []
    for each in scene.objects:
        kind = each.field.type if each.field and not each.hide_viewport else "NONE"
        if kind not in ("NONE", "WIND"):
            remarks.append(f"{each.name}: only wind acts on balloons, and no field of another type")
        elif kind == "WIND" and (each.field.noise or each.field.falloff_power or each.field.use_max_distance):
            remarks.append(f"{each.name}: blows alike everywhere, without its noise and falloff")
    return remarks


def _names_of(scene: Scene, parts: list[Part]) -> set[str]:
    """Return the names of all objects that a bake of parts looks at."""
    names = {name for each in parts for name in (each.original.name_full, each.key[0])}
    names |= {string.name_full for each in parts if (string := properties.of(each.original).string)}
    return names | {each.name_full for each in scene.objects if _is_wind(each)}


def _moves(scene: Scene, names: set[str]) -> bool:
    """Return whether objects of these names, or gravity, depend on time: whether a new frame updates them."""
    found: set[str] = set()

    def note(_: Scene, graph: Depsgraph) -> None:
        found.update(update.id.name_full for update in graph.updates if isinstance(update.id, Object))

    bpy.app.handlers.frame_change_post.append(note)
    try:
        for frame in (scene.frame_start, scene.frame_start + 1):  # the first also evaluates what waited
            found.clear()
            scene.frame_set(frame)
    finally:
        bpy.app.handlers.frame_change_post.remove(note)
    return scene.animation_data is not None or not names.isdisjoint(found)


def _follow(context: Context, there: list[Object], things: dict[Any, Thing], snapshot: Snapshot) -> None:
    """Record motion and keyframes from frame to frame."""
    scene, instanced = context.scene, any(len(key) > 1 for key in things)
    motions = {key: Motion(thing) for key, thing in things.items()}
    winds, gravities = [], []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        graph, missing = context.evaluated_depsgraph_get(), set(motions)
        winds.append(_wind(scene, graph))
        gravities.append(_gravity(scene.evaluated_get(graph)))
        for part in _parts_of(graph, there, instanced):
            if part.key in motions:
                motions[part.key].add(part, graph)
                missing.discard(part.key)
            elif len(part.key) > 1:
                missing.add(part.key)
        if missing:
            name = next(iter(missing))[0]
            raise RefusedError(f"{name}: its instances are others in frame {frame}; expected the same in all frames")
    snapshot.winds, snapshot.gravities = _changing(np.array(winds)), _changing(np.array(gravities))
    for motion in motions.values():
        motion.finish()


class Motion:
    """Places and shape of a part, frame by frame.

    Args:
        thing: the part at the start, which gets its motion in the end.
    """

    def __init__(self, thing: Thing):
        self._thing = thing
        self._places: list[np.ndarray] = []
        self._shapes: list[np.ndarray] = []
        self._anchors: list[np.ndarray] = []
        self._amounts: list[float] = []

    def add(self, part: Part, graph: Depsgraph) -> None:
        """Note the part in the next frame.

        Raises:
            RefusedError: its mesh has another number of vertices than at the start.
        """
        thing, settings = self._thing, properties.of(part.original)
        self._places.append(part.place)
        self._amounts.append(getattr(properties.of(part.evaluated), properties.amount_of(thing.settings["inflate"])))
        if settings.string:
            self._anchors.append(_place_of(settings.string, graph))
        if thing.role == "OBSTACLE" or len(thing.pinned):
            points = _points(part.evaluated.to_mesh())
            part.evaluated.to_mesh_clear()
            if points.shape != thing.points.shape:
                raise RefusedError(
                    f"{thing.name}: has {len(points)} vertices in a later frame; expected {len(thing.points)}, as at "
                    "the start"
                )
            same = np.abs(points - thing.points).max() <= RIGID * np.ptp(thing.points)
            self._shapes.append(thing.points if same and thing.role == "OBSTACLE" else points)

    def finish(self) -> None:
        """Give the thing its motion.

        Raises:
            RefusedError: it has no size in a frame.
        """
        thing = self._thing
        thing.places = _changing(np.array(self._places))
        thing.amounts = _changing(np.array(self._amounts)).tolist()
        thing.anchors = _changing(np.array(self._anchors)) if self._anchors else None
        stays = all(shape is thing.points for shape in self._shapes)
        if thing.role == "OBSTACLE" and not (stays and is_rigid(thing.places)):
            thing.pinned = np.arange(len(thing.points))
        elif thing.role != "OBSTACLE":
            for place in thing.places:
                _require_size(thing.name, place)
        if len(thing.pinned):
            pairs = zip(self._shapes, self._places, strict=True)
            thing.paths = _changing(np.array([in_world(shape[thing.pinned], place) for shape, place in pairs]))


def _require_size(name: str, place: np.ndarray) -> None:
    """Make sure that an object has a size.

    Raises:
        RefusedError: it has not.
    """
    if np.linalg.matrix_rank(place[:3, :3]) < 3:
        raise RefusedError(f"{name}: has a scale of 0; expected another along each axis")


def _place_of(thing: Object, graph: Depsgraph) -> np.ndarray:
    """Return the place of an object in the world."""
    return np.array(thing.evaluated_get(graph).matrix_world.translation, np.float64)


def _changing(values: np.ndarray) -> np.ndarray:
    """Return values of frames, or the first alone where all are alike."""
    return values if (values != values[:1]).any() else values[:1]
