"""Reading of a Blender scene for a bake: evaluated meshes, and motion from frame to frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from bpy.types import Context, Depsgraph, Object, Scene

from . import modifiers, properties
from .motion import Motion, changing, place_of, require_size
from .parts import Part, is_wind, left_out, moves, names_of, objects_of, parts_of
from .snapshot import RefusedError, Snapshot, Thing, in_world

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
    taking = objects_of(context)
    with _as_it_was(scene), _without_caches(taking):
        return _snapshot(context, taking)


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
    parts = [(part, _read(part, graph)) for part in parts_of(graph, there)]
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
        remarks=left_out(scene),
    )
    if moves(scene, names_of(scene, [part for part, _ in parts])):
        _follow(context, there, things, snapshot)
    return snapshot


def _values(group: bpy.types.PropertyGroup) -> dict[str, Any]:
    """Return the values of a panel's properties by their names."""
    return {name: getattr(group, name) for name in group.__annotations__}


def _read(part: Part, graph: Depsgraph) -> Thing:
    """Read a part as it is at the start."""
    mesh = part.evaluated.to_mesh()
    try:
        points = np.empty(3 * len(mesh.vertices), np.float32)
        counts, corners = np.empty(len(mesh.polygons), np.int32), np.empty(len(mesh.loops), np.int32)
        mesh.vertices.foreach_get("co", points)
        mesh.polygons.foreach_get("loop_total", counts)
        mesh.loops.foreach_get("vertex_index", corners)
        pinned = _pinned(part.original, mesh)
    finally:
        part.evaluated.to_mesh_clear()
    require_size(part.name, part.place)
    settings = _values(properties.of(part.original))
    anchor = settings.pop("string")
    points = points.reshape(-1, 3).astype(np.float64)
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
        anchors=place_of(anchor, graph)[None] if anchor else None,
    )


def _pinned(original: Object, mesh: bpy.types.Mesh) -> np.ndarray:
    """Return the vertices of a balloon's pin group."""
    settings = properties.of(original)
    if settings.role != "BALLOON" or not (name := settings.pinned):
        return np.zeros(0, np.int64)
    if name not in original.vertex_groups:
        raise RefusedError(f"{original.name}: has no vertex group {name}; expected the name of its pin group")
    group = original.vertex_groups[name].index
    weights = [sum(each.weight for each in vertex.groups if each.group == group) for vertex in mesh.vertices]
    return np.flatnonzero(np.array(weights) >= PINNED)


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
        if is_wind(each):
            evaluated = each.evaluated_get(graph)
            axis = np.array(evaluated.matrix_world, np.float64)[:3, 2]
            total += evaluated.field.strength * axis / np.linalg.norm(axis)
    return total


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
        for part in parts_of(graph, there, instanced):
            if part.key in motions:
                motions[part.key].add(part, graph)
                missing.discard(part.key)
            elif len(part.key) > 1:
                missing.add(part.key)
        if missing:
            name = next(iter(missing))[0]
            raise RefusedError(f"{name}: its instances are others in frame {frame}; expected the same in all frames")
    snapshot.winds, snapshot.gravities = changing(np.array(winds)), changing(np.array(gravities))
    for motion in motions.values():
        motion.finish()
