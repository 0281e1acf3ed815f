"""The Mesh Cache modifier that plays a bake.

Modifiers above it shape the mesh that is inflated, those below it the result.
"""

import os
from itertools import takewhile
from pathlib import Path

import bpy
from bpy.types import Modifier, Object, Scene

NAME = "Balloon"


def find(thing: Object) -> Modifier | None:
    """Return an object's modifier, if it has one."""
    found = thing.modifiers.get(NAME)
    return found if found and found.type == "MESH_CACHE" else None


def add(thing: Object) -> Modifier:
    """Give an object the modifier at the end of its stack, or return the one that it has; it rests until a bake."""
    if found := find(thing):
        return found
    made = thing.modifiers.new(NAME, "MESH_CACHE")
    made.name = NAME
    rest(made)
    return made


def from_cache_on(thing: Object) -> list[Modifier]:
    """Return an object's modifiers from the one of a bake on; none, where it has none."""
    return list(thing.modifiers)[len(above(thing)) :]


def above(thing: Object) -> list[Modifier]:
    """Return an object's modifiers that shape the mesh that is inflated."""
    return list(takewhile(lambda each: each != find(thing), thing.modifiers))


def remove(thing: Object) -> None:
    """Take the modifier away."""
    if found := find(thing):
        thing.modifiers.remove(found)


def play(modifier: Modifier, path: Path, first: int) -> None:
    """Let the modifier play a cache from a frame on; beside the .blend its path is relative, so that both can move."""
    modifier.cache_format = "PC2"
    modifier.filepath = shown_path(path)
    modifier.frame_start = first
    modifier.interpolation = "LINEAR"
    modifier.show_viewport = modifier.show_render = True


def rest(modifier: Modifier) -> None:
    """Let the modifier do nothing."""
    modifier.filepath = ""
    modifier.show_viewport = modifier.show_render = False


def state(modifier: Modifier) -> tuple[str, bool]:
    """Return the path of a modifier's cache, and whether it plays, for `restore`."""
    return modifier.filepath, modifier.show_viewport


def restore(modifier: Modifier, before: tuple[str, bool]) -> None:
    """Let a modifier play its cache of before."""
    modifier.filepath, modifier.show_viewport = before
    modifier.show_render = modifier.show_viewport


def refresh(scene: Scene) -> None:
    """Let Blender evaluate the objects again that play a cache."""
    for thing in caches_of(scene):
        thing.update_tag()


def move(thing: Object, path: str) -> None:
    """Let the modifier play its cache from another place."""
    if found := find(thing):
        found.filepath = path


def shown_path(path: Path) -> str:
    """Return a path as the .blend keeps it."""
    if bpy.data.filepath and path.is_relative_to(Path(bpy.data.filepath).parent):
        return bpy.path.relpath(str(path))
    return str(path)


def cache_of(thing: Object) -> Path | None:
    """Return the path of the cache that an object plays."""
    found = find(thing)
    return Path(os.path.abspath(bpy.path.abspath(found.filepath))) if found and found.filepath else None


def caches_of(scene: Scene) -> dict[Object, Path]:
    """Return the caches that objects of a scene play."""
    found = {thing: cache_of(thing) for thing in scene.objects}
    return {thing: path for thing, path in found.items() if path}


def player(scene: Scene, name: str) -> Object | None:
    """Return the object of a name that can play a cache: one that is linked from another file may have it, too."""
    return next((thing for thing in scene.objects if thing.name == name and thing.is_editable), None)
