"""Parts of a scene that a bake looks at: objects with a role, and instances of obstacles."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.types import Context, Depsgraph, Modifier, Object, Scene

from . import modifiers, properties
from .snapshot import RefusedError

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
    """The object as Blender evaluates it; of an instance it lasts while `parts_of` is at it"""
    place: np.ndarray
    """Matrix from its own axes to the world's, shape (4, 4)"""


def parts_of(graph: Depsgraph, taking: list[Object], instanced: bool = True) -> Iterator[Part]:
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


def objects_of(context: Context) -> list[Object]:
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


def mesh_points(evaluated: Object) -> np.ndarray:
    """Return the points of an evaluated object in its own axes, shape (n, 3)."""
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    return points.reshape(-1, 3).astype(np.float64)


def is_wind(thing: Object) -> bool:
    """Return whether an object is a wind that blows."""
    return bool(thing.field) and thing.field.type == "WIND" and not thing.hide_viewport


def left_out(scene: Scene) -> list[str]:
    """Return sentences on force fields that a bake leaves out, or takes for simpler ones."""
    remarks = []
    for each in scene.objects:
        kind = each.field.type if each.field and not each.hide_viewport else "NONE"
        if kind not in ("NONE", "WIND"):
            remarks.append(f"{each.name}: only wind acts on balloons, and no field of another type")
        elif kind == "WIND" and (each.field.noise or each.field.falloff_power or each.field.use_max_distance):
            remarks.append(f"{each.name}: blows alike everywhere, without its noise and falloff")
    return remarks


def names_of(scene: Scene, parts: list[Part]) -> set[str]:
    """Return the names of all objects that a bake of parts looks at."""
    names = {name for each in parts for name in (each.original.name_full, each.key[0])}
    names |= {string.name_full for each in parts if (string := properties.of(each.original).string)}
    return names | {each.name_full for each in scene.objects if is_wind(each)}


def moves(scene: Scene, names: set[str]) -> bool:
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
