"""Modifiers of a bake: Balloon, a Mesh Cache, plays it, and Geometry Nodes below it take away the faces that are torn.

Modifiers above Balloon shape the mesh that is inflated, those below it the result. The frame in which each face tears
is an attribute of a mesh with a point for each, which no collection shows.
"""

import os
from itertools import takewhile
from pathlib import Path

import bpy
import numpy as np
from bpy.types import GeometryNodeTree, Modifier, Object, Scene

from .request import NEVER, tears_of

NAME = "Balloon"
TEARS = "Balloon Tears"
TORN = "torn"
"""Attribute with the frames in which faces tear"""


def find(thing: Object) -> Modifier | None:
    """Return an object's modifier that plays a bake, if it has one."""
    found = thing.modifiers.get(NAME)
    return found if found and found.type == "MESH_CACHE" else None


def add(thing: Object) -> Modifier:
    """Give an object the modifier at the end of its stack, or return the one that it has; it rests until a bake."""
    if found := find(thing):
        return found
    made = thing.modifiers.new(NAME, "MESH_CACHE")
    made.name = NAME
    _switch_off(made)
    return made


def remove(thing: Object) -> None:
    """Take the modifiers of a bake away."""
    if found := find(thing):
        thing.modifiers.remove(found)
    remove_tears(thing)


def from_cache_on(thing: Object) -> list[Modifier]:
    """Return an object's modifiers from the one of a bake on; none, where it has none."""
    return list(thing.modifiers)[len(above(thing)) :]


def above(thing: Object) -> list[Modifier]:
    """Return an object's modifiers that shape the mesh that is inflated."""
    return list(takewhile(lambda each: each != find(thing), thing.modifiers))


def play(thing: Object, cache: Path, first: int) -> None:
    """Let an object play a cache from a frame on; beside the .blend its path is relative, so that both can move."""
    modifier = add(thing)
    modifier.cache_format = "PC2"
    modifier.filepath = shown_path(cache)
    modifier.frame_start = first
    modifier.interpolation = "LINEAR"
    modifier.show_viewport = modifier.show_render = True


def rest(thing: Object) -> None:
    """Let an object play nothing."""
    if found := find(thing):
        _switch_off(found)
    remove_tears(thing)


def _switch_off(modifier: Modifier) -> None:
    modifier.filepath = ""
    modifier.show_viewport = modifier.show_render = False


def state(modifier: Modifier) -> tuple[str, bool]:
    """Return the path of a modifier's cache, and whether it plays, for `restore`."""
    return modifier.filepath, modifier.show_viewport


def restore(modifier: Modifier, before: tuple[str, bool]) -> None:
    """Let a modifier play its cache of before."""
    modifier.filepath, modifier.show_viewport = before
    modifier.show_render = modifier.show_viewport


def move(thing: Object, path: str) -> None:
    """Let an object play its cache from another place."""
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


def refresh(scene: Scene) -> None:
    """Play the frames and tears that a bake has written so far."""
    for thing, cache in caches_of(scene).items():
        found, tears = find(thing), find_tears(thing)
        if found and tears and (faces := tears[_socket(tears)]):
            _put(faces.data, tears_of(cache), found.frame_start)
        thing.update_tag()


def find_tears(thing: Object) -> Modifier | None:
    """Return an object's modifier that takes torn faces away, if it has one."""
    found = thing.modifiers.get(TEARS)
    return found if found and found.type == "NODES" else None


def add_tears(thing: Object, face_count: int) -> None:
    """Let faces of an object tear, directly below its modifier of the bake."""
    remove_tears(thing)
    mesh = bpy.data.meshes.new(TEARS)
    mesh.vertices.add(face_count)
    torn = mesh.attributes.new(TORN, "FLOAT", "POINT")
    torn.data.foreach_set("value", np.full(face_count, NEVER, np.float32))
    made = thing.modifiers.new(TEARS, "NODES")
    made.name, made.node_group = TEARS, _nodes()
    made[_socket(made)] = bpy.data.objects.new(TEARS, mesh)
    thing.modifiers.move(len(thing.modifiers) - 1, len(above(thing)) + 1)


def remove_tears(thing: Object) -> None:
    """Let faces of an object tear no more."""
    if not (found := find_tears(thing)):
        return
    faces = found[_socket(found)]
    thing.modifiers.remove(found)
    if faces and not faces.users:
        bpy.data.meshes.remove(faces.data)  # and the object with it


def show_tears(thing: Object, torn: bool) -> None:
    """Show an object with its tears or without."""
    if found := find_tears(thing):
        found.show_viewport = torn


def _put(mesh: bpy.types.Mesh, path: Path, first: float) -> None:
    """Put the frames of a file, counted from the first, into the attribute."""
    if not path.exists():
        return
    frames, torn = np.fromfile(path, "<f4") + np.float32(first), mesh.attributes[TORN].data
    before = np.empty(len(torn), np.float32)
    torn.foreach_get("value", before)
    if frames.shape == before.shape and (frames != before).any():
        torn.foreach_set("value", frames)
        mesh.update()


def _socket(of: Modifier) -> str:
    """Return the name by which a modifier knows the input of the nodes that is the mesh with the frames."""
    return next(each.identifier for each in of.node_group.interface.items_tree if each.name == "Faces")


def _nodes() -> GeometryNodeTree:
    """Return the nodes: faces go whose frame is not after that of the scene."""
    if found := bpy.data.node_groups.get(TEARS):
        return found
    tree = bpy.data.node_groups.new(TEARS, "GeometryNodeTree")
    sockets = (("Geometry", "INPUT", "Geometry"), ("Faces", "INPUT", "Object"), ("Geometry", "OUTPUT", "Geometry"))
    for name, direction, kind in sockets:
        tree.interface.new_socket(name, in_out=direction, socket_type=f"NodeSocket{kind}")
    kinds = {
        "given": "NodeGroupInput",
        "faces": "GeometryNodeObjectInfo",
        "frame": "GeometryNodeInputNamedAttribute",
        "number": "GeometryNodeInputIndex",
        "own": "GeometryNodeSampleIndex",
        "now": "GeometryNodeInputSceneTime",
        "is_torn": "FunctionNodeCompare",
        "whole": "GeometryNodeDeleteGeometry",
        "result": "NodeGroupOutput",
    }
    nodes = {name: tree.nodes.new(kind) for name, kind in kinds.items()}
    nodes["frame"].data_type = nodes["own"].data_type = nodes["is_torn"].data_type = "FLOAT"
    nodes["frame"].inputs["Name"].default_value = TORN
    nodes["own"].domain, nodes["whole"].domain = "POINT", "FACE"
    nodes["is_torn"].operation = "LESS_EQUAL"
    for number, (name, node) in enumerate(nodes.items()):
        node.label, node.location = name.replace("_", " "), (200.0 * number, 0.0)
    links = (
        ("given", "Geometry", "whole", "Geometry"),
        ("given", "Faces", "faces", "Object"),
        ("faces", "Geometry", "own", "Geometry"),
        ("frame", "Attribute", "own", "Value"),
        ("number", "Index", "own", "Index"),
        ("own", "Value", "is_torn", "A"),
        ("now", "Frame", "is_torn", "B"),
        ("is_torn", "Result", "whole", "Selection"),
        ("whole", "Geometry", "result", "Geometry"),
    )
    for source, output, target, taken in links:
        tree.links.new(nodes[source].outputs[output], nodes[target].inputs[taken])
    return tree
