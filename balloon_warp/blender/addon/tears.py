"""Tears of balloons that burst: Geometry Nodes below Balloon take away the faces that are torn.

The frame in which each face tears is an attribute of a mesh with a point for each, which no collection shows.
"""

from pathlib import Path

import bpy
import numpy as np
from bpy.types import GeometryNodeTree, Modifier, Object, Scene

from . import modifiers
from .request import NEVER, tears_of

NAME = "Balloon Tears"
ATTRIBUTE = "torn"


def find(thing: Object) -> Modifier | None:
    """Return an object's modifier that takes torn faces away, if it has one."""
    found = thing.modifiers.get(NAME)
    return found if found and found.type == "NODES" else None


def add(thing: Object, face_count: int) -> None:
    """Let faces of an object tear, directly below its modifier of the bake."""
    remove(thing)
    mesh = bpy.data.meshes.new(NAME)
    mesh.vertices.add(face_count)
    torn = mesh.attributes.new(ATTRIBUTE, "FLOAT", "POINT")
    torn.data.foreach_set("value", np.full(face_count, NEVER, np.float32))
    made = thing.modifiers.new(NAME, "NODES")
    made.name, made.node_group = NAME, _nodes()
    made[_socket(made)] = bpy.data.objects.new(NAME, mesh)
    thing.modifiers.move(len(thing.modifiers) - 1, len(modifiers.above(thing)) + 1)


def remove(thing: Object) -> None:
    """Let faces of an object tear no more."""
    if not (found := find(thing)):
        return
    faces = found[_socket(found)]
    thing.modifiers.remove(found)
    if faces and not faces.users:
        bpy.data.meshes.remove(faces.data)  # and the object with it


def show(thing: Object, torn: bool) -> None:
    """Show an object with its tears or without."""
    if found := find(thing):
        found.show_viewport = torn


def refresh(scene: Scene) -> None:
    """Take the tears so far from the files of a bake."""
    for thing, cache in modifiers.caches_of(scene).items():
        player, found = modifiers.find(thing), find(thing)
        if player and found and (faces := found[_socket(found)]):
            _put(faces.data, tears_of(cache), player.frame_start)


def _put(mesh: bpy.types.Mesh, path: Path, first: float) -> None:
    """Put the frames of a file, counted from the first, into the attribute."""
    if not path.exists():
        return
    frames, torn = np.fromfile(path, "<f4") + np.float32(first), mesh.attributes[ATTRIBUTE].data
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
    if found := bpy.data.node_groups.get(NAME):
        return found
    tree = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    for name, direction, kind in (
        ("Geometry", "INPUT", "Geometry"),
        ("Faces", "INPUT", "Object"),
        ("Geometry", "OUTPUT", "Geometry"),
    ):
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
    nodes["frame"].inputs["Name"].default_value = ATTRIBUTE
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
