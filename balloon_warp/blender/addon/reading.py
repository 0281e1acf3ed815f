"""Reading of a Blender scene for a bake: evaluated meshes, and motion from frame to frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from bpy.types import Context, Depsgraph, Object, Scene

from . import modifier, properties
from .snapshot import RefusedError, Snapshot, Thing

PINNED = 0.5
"""Weight from which on a vertex of the pin group is pinned"""


def read_scene(context: Context) -> Snapshot:
    """Read all that takes part, from the first frame to the last; the scene is left as it was.

    Raises:
        RefusedError: something cannot be baked; it names the object.
    """
    scene = context.scene
    if scene.frame_end <= scene.frame_start:
        raise RefusedError(f"{scene.name}: its frame range ends before it begins; expected two frames or more")
    taking = [thing for thing in scene.objects if properties.of(thing).role != "NONE" and thing.type == "MESH"]
    if not any(properties.of(thing).role == "BALLOON" for thing in taking):
        raise RefusedError(f"{scene.name}: has no balloon; select a mesh and press Inflate")
    for thing in taking:
        _check(thing)
    with _as_it_was(scene), _without_caches(taking):
        return _snapshot(context, taking)


def _check(thing: Object) -> None:
    if thing.mode == "EDIT":
        raise RefusedError(f"{thing.name}: is in Edit Mode; expected Object Mode")
    if properties.of(thing).role != "OBSTACLE" and not thing.is_editable:
        raise RefusedError(f"{thing.name}: is linked from another file; expected a library override of it")


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
    below = [each for thing in things if modifier.find(thing) for each in _from_cache_on(thing)]
    shown = [(each, each.show_viewport) for each in below]
    try:
        for each in below:
            each.show_viewport = False
        yield
    finally:
        for each, show in shown:
            each.show_viewport = show


def _from_cache_on(thing: Object) -> list[bpy.types.Modifier]:
    stack = list(thing.modifiers)
    return stack[[each.name for each in stack].index(modifier.NAME) :]


def _snapshot(context: Context, taking: list[Object]) -> Snapshot:
    scene, render = context.scene, context.scene.render
    scene.frame_set(scene.frame_start)
    graph = context.evaluated_depsgraph_get()
    there = [each for each in taking if each.evaluated_get(graph).is_evaluated]  # also what is hidden by its eye alone
    things = [(each, _read(each, graph)) for each in there]
    gravity = np.array(scene.gravity) if scene.use_gravity else np.zeros(3)
    if np.abs(gravity[:2]).max() > 1e-6:
        raise RefusedError(f"{scene.name}: its gravity has a part along X or Y; expected one along Z")
    units = scene.unit_settings
    snapshot = Snapshot(
        things=[thing for _, thing in things],
        frames=scene.frame_end - scene.frame_start,
        frames_per_second=render.fps / render.fps_base,
        meters=1.0 if units.system == "NONE" else units.scale_length,
        gravity=-float(gravity[2]),
        settings=_values(properties.of(scene)),
        winds=_wind(scene, graph)[None],
    )
    if _moves(scene, [each for each, _ in things]):
        _follow(context, things, snapshot)
    return snapshot


def _values(group: bpy.types.PropertyGroup) -> dict[str, Any]:
    """Return the values of a panel's properties by their names."""
    return {name: getattr(group, name) for name in group.__annotations__}


def _read(original: Object, graph: Depsgraph) -> Thing:
    """Read an object as it is now."""
    evaluated = original.evaluated_get(graph)
    mesh, name = evaluated.to_mesh(), original.name
    try:
        points = np.empty(3 * len(mesh.vertices), np.float32)
        counts, corners = np.empty(len(mesh.polygons), np.int32), np.empty(len(mesh.loops), np.int32)
        mesh.vertices.foreach_get("co", points)
        mesh.polygons.foreach_get("loop_total", counts)
        mesh.loops.foreach_get("vertex_index", corners)
        pinned = _pinned(original, mesh)
    finally:
        evaluated.to_mesh_clear()
    if not len(counts):
        raise RefusedError(f"{name}: has no faces; expected a mesh with a surface")
    place = np.array(evaluated.matrix_world, np.float64)
    if np.linalg.matrix_rank(place[:3, :3]) < 3:
        raise RefusedError(f"{name}: has a scale of 0; expected another along each axis")
    settings = _values(properties.of(original))
    anchor = settings.pop("string")
    return Thing(
        name=name,
        settings=settings,
        points=points.reshape(-1, 3).astype(np.float64),
        counts=counts,
        corners=corners,
        places=place[None],
        pinned=pinned,
        amounts=[settings[properties.amount_of(settings["inflate"])]],
        anchors=_place_of(anchor, graph)[None] if anchor else None,
    )


def _pinned(original: Object, mesh: bpy.types.Mesh) -> np.ndarray:
    """Return the vertices of the pin group."""
    name = properties.of(original).pinned
    if not name:
        return np.zeros(0, np.int64)
    if name not in original.vertex_groups:
        raise RefusedError(f"{original.name}: has no vertex group {name}; expected the name of its pin group")
    group = original.vertex_groups[name].index
    weights = [sum(each.weight for each in vertex.groups if each.group == group) for vertex in mesh.vertices]
    return np.flatnonzero(np.array(weights) >= PINNED)


def _place_of(thing: Object, graph: Depsgraph) -> np.ndarray:
    return np.array(thing.evaluated_get(graph).matrix_world.translation, np.float64)


def _wind(scene: Scene, graph: Depsgraph) -> np.ndarray:
    """Return the sum of the wind force fields: their strengths, along their own Z axes [m/s]."""
    total = np.zeros(3)
    for each in scene.objects:
        if each.field and each.field.type == "WIND" and not each.hide_viewport:
            place = np.array(each.evaluated_get(graph).matrix_world, np.float64)
            total += each.field.strength * place[:3, 2] / np.linalg.norm(place[:3, 2])
    return total


def _moves(scene: Scene, things: list[Object]) -> bool:
    """Return whether anything that a bake looks at depends on time, by what another frame makes Blender evaluate."""
    looked_at = {each.name for each in things}
    looked_at |= {anchor.name for each in things if (anchor := properties.of(each).string)}
    looked_at |= {each.name for each in scene.objects if each.field and each.field.type == "WIND"}
    found = set()

    def note(_: Scene, graph: Depsgraph) -> None:
        found.update(update.id.name for update in graph.updates if isinstance(update.id, Object))

    bpy.app.handlers.frame_change_post.append(note)
    try:
        for frame in (scene.frame_start, scene.frame_start + 1):  # the first also evaluates what waited
            found.clear()
            scene.frame_set(frame)
    finally:
        bpy.app.handlers.frame_change_post.remove(note)
    return not looked_at.isdisjoint(found)


def _follow(context: Context, things: list[tuple[Object, Thing]], snapshot: Snapshot) -> None:
    """Record motion and keyframes from frame to frame."""
    scene = context.scene
    places: list[list[np.ndarray]] = [[] for _ in things]
    anchors: list[list[np.ndarray]] = [[] for _ in things]
    amounts: list[list[float]] = [[] for _ in things]
    winds = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        graph = context.evaluated_depsgraph_get()
        winds.append(_wind(scene, graph))
        for number, (original, thing) in enumerate(things):
            evaluated = original.evaluated_get(graph)
            places[number].append(np.array(evaluated.matrix_world, np.float64))
            amount = properties.amount_of(thing.settings["inflate"])
            amounts[number].append(getattr(properties.of(evaluated), amount))
            if thing.anchors is not None:
                anchors[number].append(_place_of(properties.of(original).string, graph))
            if thing.role == "OBSTACLE":
                _require_rigid(thing, evaluated)
    snapshot.winds = _changing(np.array(winds))
    for number, (_, thing) in enumerate(things):
        thing.places = _changing(np.array(places[number]))
        thing.amounts = _changing(np.array(amounts[number])).tolist()
        if thing.anchors is not None:
            thing.anchors = _changing(np.array(anchors[number]))


def _require_rigid(thing: Thing, evaluated: Object) -> None:
    """Make sure that an obstacle does not bend.

    Raises:
        RefusedError: it does.
    """
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    same = points.size == thing.points.size
    if not same or np.abs(points.reshape(-1, 3) - thing.points).max() > 1e-4 * np.ptp(thing.points):
        raise RefusedError(f"{thing.name}: bends as it moves; expected an obstacle that keeps its shape")


def _changing(values: np.ndarray) -> np.ndarray:
    """Return values of frames, or the first alone where all are alike."""
    return values if (values != values[:1]).any() else values[:1]
