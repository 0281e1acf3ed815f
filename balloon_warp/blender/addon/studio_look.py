"""Look of our pictures in Cycles, for a stage that Blender has imported: thin latex, crisp softboxes, no horizon.

It needs nothing but `bpy`, and is a script of its own, too. `blender --python studio_look.py -- balloon.usdc` imports a
stage into an empty scene and dresses it. Run in Blender's Scripting tab it dresses the scene that is open.
"""

import sys
from collections.abc import Sequence
from operator import mul, truediv
from typing import Any

import bpy
from bpy.types import Material, Node, NodeSocket, NodeTree, Object, Scene, World
from mathutils import Vector

Color = tuple[float, float, float]

TRANSFORM = "Khronos PBR Neutral"
"""View transform of our own pictures: it keeps the colors of things"""
DRESSED = "balloon_warp_studio_look"
"""Property of a scene that has this look already"""

USUAL = 0.08
"""Transparency, one less the preview surface's opacity, of an unstretched wall of thickness one"""
PALER = 0.6
"""Power of the thickness that shows"""
CLOUDY, DYED, DEEPEST = 0.8, 0.56, 3.4
"""A wall of thickness one scatters all but exp(-CLOUDY) of the light, and tints it by the power DYED of its color; it
is DEEPEST times as deep where it is seen edge-on"""
AT_START, THINNED = "area_at_start", "thinned"
"""Attributes of a balloon: the areas of its faces at the start, and the share of them now at its points"""

KEY_WIDTH, KEY_DISTANCE = 1.7, 4.0
"""Width and distance of the stage's lamp "Key", in sizes of the subject"""
CARDS = {"Key": (2.7, 3.5, 28.0), "Rim": (1.1, 5.6, 8.0)}
"""Width and height, in sizes of the subject, and light of the softboxes that mirrors see in place of lamps"""
BAR = 0.045
"""Half the width of the bar across the key's softbox, in halves of its height"""
KEY_LIGHT, KEY_ANGLE = 3.3, 0.3
"""Strength and angle [rad] of the key light: a sun, so that it lights all of the floor evenly"""
SKY, BOUNCE = (0.34, 0.35, 0.37), (0.25, 0.24, 0.22)
"""Light from above and from below the horizon"""
ROOM = (
    (-1.0, (0.32, 0.31, 0.30)),
    (-0.06, (0.57, 0.56, 0.53)),
    (0.03, (0.30, 0.29, 0.29)),
    (0.66, (0.62, 0.64, 0.68)),
    (0.78, (1.25, 1.25, 1.25)),
)
"""Light of the room that mirrors see, by the height of their direction: floor, wall, and a white cloth overhead"""
PAPER = ((0.90, 0.86, 0.80), (0.86, 0.83, 0.80))
"""Light of the backdrop at the bottom and at the top of the picture"""
WHITE = (0.72, 0.70, 0.66)
"""Color of the paper where a scene says none"""
SWEEP = (1.0, 6.0)
"""Distances from the subject between which the floor passes into the backdrop, in sizes of the subject"""
DIM = 0.5
"""Share of the floor's light that falls back on the subject, which would look milky in all of it"""


def import_stage(path: str) -> Scene:
    """Import a stage into an empty scene, dress it, and return the scene."""
    bpy.ops.wm.read_factory_settings()
    bpy.data.batch_remove(bpy.data.objects)
    bpy.ops.wm.usd_import(filepath=path)
    dress(bpy.context.scene)
    return bpy.context.scene


def can_dress(scene: Scene) -> bool:
    """Return whether a scene came from a stage of ours with lights, and has not this look yet."""
    return not scene.get(DRESSED) and {"Key", "Rim", "Top"} <= set(scene.objects.keys())


def dress(scene: Scene) -> None:
    """Give a scene that came from a stage of ours its look, camera and render settings; once is enough."""
    if scene.get(DRESSED):
        return
    scene[DRESSED] = True
    for thing in scene.objects:
        moves = any(each.type == "MESH_SEQUENCE_CACHE" for each in thing.modifiers)
        if moves and any(map(_is_latex, _materials(thing))):
            thing.modifiers.new("Thinned", "NODES").node_group = _thinning(thing)
            smooth = thing.modifiers.new("Smooth", "SUBSURF")
            smooth.levels, smooth.render_levels = 1, 2
    for material in bpy.data.materials:
        if _is_latex(material):
            _make_latex(material)
        elif (skin := _skin(material)) and skin.inputs["Metallic"].default_value > 0.0:
            skin.inputs["Roughness"].default_value = 0.06
    if "Key" in scene.objects:
        _light(scene)
    scene.camera = scene.objects.get("Camera") or scene.camera
    scene.render.engine = "CYCLES"
    scene.cycles.transparent_max_bounces = 24  # rays pass many walls
    scene.view_settings.view_transform = TRANSFORM


def _materials(thing: Object) -> list[Material]:
    return [slot.material for slot in thing.material_slots if slot.material]


def _skin(material: Material) -> Any:
    """Return the node of a material's surface as it was imported, or None."""
    nodes = material.node_tree.nodes if material.node_tree else ()
    return next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)


def _is_latex(material: Material) -> bool:
    skin = _skin(material)
    return bool(skin) and skin.inputs["Alpha"].default_value < 1.0 and skin.inputs["Coat Weight"].default_value > 0.0


class Wiring:
    """Nodes of a material or a world, made one from another by their sockets."""

    def __init__(self, owner: Material | World):
        if owner.node_tree is None:  # before Blender 5
            owner.use_nodes = True
        self.tree: Any = owner.node_tree

    def node(self, kind: str, *values: object, **settings: object) -> Node:
        """Return a new node whose inputs, in order, have values or come from other nodes' sockets."""
        node = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        for socket, value in zip([each for each in node.inputs if each.enabled], values, strict=False):
            self._set(socket, value)
        return node

    def _set(self, socket: NodeSocket, value: object) -> None:
        if isinstance(value, NodeSocket):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def math(self, operation: str, *values: object) -> NodeSocket:
        """Return the result of arithmetic on numbers."""
        return self.node("ShaderNodeMath", *values, operation=operation).outputs[0]

    def vector(self, operation: str, *values: object) -> NodeSocket:
        """Return the result of arithmetic on vectors or colors."""
        node = self.node("ShaderNodeVectorMath", *values, operation=operation)
        return next(each for each in node.outputs if each.enabled)

    def mix(self, share: NodeSocket, none: object, whole: object) -> NodeSocket:
        """Return a color between two."""
        node = self.node("ShaderNodeMix", share, none, whole, data_type="VECTOR")
        return next(each for each in node.outputs if each.enabled)

    def smooth_step(self, value: NodeSocket, begin: float, end: float) -> NodeSocket:
        """Return a number that rises from 0 to 1 between two values."""
        return self.node("ShaderNodeMapRange", value, begin, end, interpolation_type="SMOOTHSTEP").outputs[0]

    def ramp(self, value: NodeSocket, stops: Sequence[tuple[float, Color]]) -> NodeSocket:
        """Return a color by a number from -1 to 1."""
        node = self.node("ShaderNodeValToRGB", self.math("MULTIPLY_ADD", value, 0.5, 0.5))
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(1.0)
        for element, (place, color) in zip(elements, stops, strict=True):
            element.position, element.color = 0.5 + 0.5 * place, (*color, 1.0)
        return node.outputs[0]

    def power(self, color: object, exponent: NodeSocket) -> NodeSocket:
        """Return a color to a power, as in Beer and Lambert's law; each component lets a little light through."""
        return self.vector("POWER", self.vector("MAXIMUM", color, (0.02, 0.02, 0.02)), exponent)

    def shader(self, kind: str, *values: object) -> NodeSocket:
        """Return a shader."""
        return self.node(f"ShaderNode{kind}", *values).outputs[0]

    def show(self, shader: NodeSocket) -> None:
        """Connect a shader to the material's output."""
        output = next(node for node in self.tree.nodes if node.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD"))
        self.tree.links.new(shader, output.inputs["Surface"])


def _thinning(thing: Object) -> NodeTree:
    """Return geometry nodes, for below the mesh cache, that compare the area at each point with that at the start."""
    start = thing.data.attributes.new(AT_START, "FLOAT", "FACE")
    start.data.foreach_set("value", [face.area for face in thing.data.polygons])
    tree: Any = bpy.data.node_groups.new("Thinned", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    names = ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeInputNamedAttribute", "GeometryNodeInputMeshFaceArea",
             "ShaderNodeMath", "GeometryNodeStoreNamedAttribute")  # fmt: skip
    came, goes, before, now, share, store = map(tree.nodes.new, names)
    before.data_type, store.data_type, store.domain, share.operation = "FLOAT", "FLOAT", "POINT", "DIVIDE"
    before.inputs["Name"].default_value, store.inputs["Name"].default_value = AT_START, THINNED
    for begin, end in (
        (came.outputs[0], store.inputs["Geometry"]),
        (before.outputs["Attribute"], share.inputs[0]),
        (now.outputs["Area"], share.inputs[1]),
        (share.outputs[0], store.inputs["Value"]),
        (store.outputs["Geometry"], goes.inputs[0]),
    ):
        tree.links.new(begin, end)
    return tree


def _make_latex(material: Material) -> None:
    """Make a thin wall of dyed rubber, which passes, scatters back and scatters forth, under a sharp gloss."""
    wires, skin = Wiring(material), _skin(material)
    color, place = skin.inputs["Base Color"], wires.node("ShaderNodeNewGeometry").outputs
    color = color.links[0].from_socket if color.is_linked else tuple(color.default_value)[:3]
    facing = wires.math("ABSOLUTE", wires.vector("DOT_PRODUCT", place["Incoming"], place["Normal"]))
    slant = wires.math("MULTIPLY_ADD", facing, 1.0 - 1.0 / DEEPEST, 1.0 / DEEPEST)
    path = wires.math("DIVIDE", _thickness(wires, skin), slant)
    clear = wires.math("EXPONENT", wires.math("MULTIPLY", path, -CLOUDY))
    scattered = wires.math("SUBTRACT", 1.0, clear)
    forth = wires.math("DIVIDE", scattered, wires.math("ADD", path, 1.0))
    back = wires.math("SUBTRACT", scattered, forth)
    through = wires.power(color, wires.math("MINIMUM", wires.math("MULTIPLY", path, DYED), 2.2))
    dyed = wires.power(color, wires.math("MINIMUM", wires.math("MULTIPLY_ADD", path, 0.4, 0.55), 1.35))
    # A shadow's ray also finds the share that is scattered forth.
    in_shadow = wires.node("ShaderNodeLightPath").outputs["Is Shadow Ray"]
    passes = wires.math("MULTIPLY_ADD", forth, in_shadow, clear)
    rubber = [
        wires.shader(kind, wires.vector("MULTIPLY", tint, share))
        for kind, tint, share in (
            ("BsdfTransparent", through, passes),
            ("BsdfTranslucent", through, forth),
            ("BsdfDiffuse", dyed, back),
        )
    ]
    rubber = wires.shader("AddShader", wires.shader("AddShader", *rubber[:2]), rubber[2])
    grazing = wires.math("POWER", wires.math("SUBTRACT", 1.0, facing), 5.0)
    mirrored = wires.math("MULTIPLY_ADD", grazing, 0.5, 0.04)  # held back where it would outline the silhouette
    mirrored = wires.math("MULTIPLY", mirrored, wires.math("MULTIPLY_ADD", place["Backfacing"], -0.5, 1.0))
    wires.show(wires.shader("MixShader", mirrored, rubber, wires.shader("BsdfGlossy", (1.0, 1.0, 1.0, 1.0), 0.0)))


def _thickness(wires: Wiring, skin: Node) -> NodeSocket:
    """Return the thickness of a wall: it grows with the opacity, and falls with stretch where that is known."""
    thinned = wires.node("ShaderNodeAttribute", attribute_name=THINNED).outputs["Fac"]
    unknown = wires.math("LESS_THAN", thinned, 1e-6)
    shown = wires.math("POWER", wires.math("ADD", thinned, unknown), PALER)
    return wires.math("MULTIPLY", shown, USUAL / max(1.0 - skin.inputs["Alpha"].default_value, 1e-6))


def _light(scene: Scene) -> None:
    """Replace lamps near by with a sun and a sky, which light all alike, and with cards that mirrors alone see."""
    key = scene.objects["Key"]
    size = key.data.size / KEY_WIDTH
    place, turn, _ = key.matrix_world.decompose()
    middle = place - turn @ Vector((0.0, 0.0, KEY_DISTANCE * size))
    for name, (width, height, light) in CARDS.items():
        if name in scene.objects:
            _add_card(scene, scene.objects[name], 0.5 * width * size, 0.5 * height * size, light)
    for thing in scene.objects:
        if thing.name in ("Top", "Rim", "Sky", "Backdrop"):
            thing.hide_render = True
    key.data.type = "SUN"
    key.data.energy, key.data.angle, key.visible_glossy = KEY_LIGHT, KEY_ANGLE, False
    scene.world = bpy.data.worlds.new("Studio")
    floor, sheet = scene.objects.get("Ground"), scene.objects.get("Backdrop")
    paper = _skin(_materials(floor or sheet)[0]).inputs["Base Color"].default_value if floor or sheet else WHITE
    _make_room(Wiring(scene.world), tuple(map(truediv, paper[:3], WHITE)))
    if floor:
        for material in _materials(floor):
            _open_floor(material, middle, size)


def _add_card(scene: Scene, lamp: Object, half_width: float, half_height: float, light: float) -> None:
    """Put a softbox in a lamp's place: brightest in its middle, the key's with a bar across."""
    name = f"{lamp.name} Card"
    mesh, material = bpy.data.meshes.new(name), bpy.data.materials.new(name)
    corners = [(x * half_width, y * half_height, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    card = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(card)
    card.location, turn, _ = lamp.matrix_world.decompose()
    card.rotation_mode, card.rotation_quaternion = "QUATERNION", turn
    card.visible_camera = card.visible_diffuse = card.visible_transmission = card.visible_shadow = False
    wires = Wiring(material)
    place = wires.node("ShaderNodeTexCoord").outputs["Object"]
    place = wires.vector("MULTIPLY", place, (1.0 / half_width, 1.0 / half_height, 0.0))
    up = wires.math("ABSOLUTE", wires.node("ShaderNodeSeparateXYZ", place).outputs["Y"])
    beside = wires.math("GREATER_THAN", up, BAR if lamp.name == "Key" else -1.0)
    shape = wires.math("MULTIPLY_ADD", wires.vector("DOT_PRODUCT", place, place), -0.3, 1.12)
    strength = wires.math("MULTIPLY", wires.math("MULTIPLY", shape, beside), light)
    wires.show(wires.shader("Emission", (1.0, 0.98, 0.95, 1.0), strength))


def _make_room(wires: Wiring, tint: Color) -> None:
    """Show the camera the backdrop, mirrors the room, and light all else by the sky."""
    seen = wires.node("ShaderNodeLightPath").outputs
    toward = wires.node("ShaderNodeSeparateXYZ", wires.node("ShaderNodeNewGeometry").outputs["Incoming"]).outputs["Z"]
    height = wires.math("MULTIPLY", toward, -1.0)
    light = wires.mix(wires.math("GREATER_THAN", height, 0.0), tuple(map(mul, BOUNCE, tint)), SKY)
    light = wires.mix(seen["Is Glossy Ray"], light, wires.ramp(height, ROOM))
    window = wires.node("ShaderNodeTexCoord").outputs["Window"]
    x, y, _ = wires.node("ShaderNodeSeparateXYZ", window).outputs
    x, y = (wires.math("MULTIPLY_ADD", each, 2.0, -1.0) for each in (x, y))
    corner = wires.math("MULTIPLY_ADD", wires.math("MULTIPLY", y, y), 0.6, wires.math("MULTIPLY", x, x))
    bright = wires.math("MULTIPLY_ADD", wires.smooth_step(corner, 0.2, 1.8), -0.12, 1.0)
    paper = wires.vector("MULTIPLY", wires.mix(wires.smooth_step(y, -0.6, 1.3), *PAPER), bright)
    paper = wires.vector("MULTIPLY", paper, tint)
    wires.show(wires.shader("Background", wires.mix(seen["Is Camera Ray"], light, paper)))


def _open_floor(material: Material, middle: Vector, size: float) -> None:
    """Blend the floor into the backdrop, so that no horizon is seen."""
    wires, paint = Wiring(material), Vector(_skin(material).inputs["Base Color"].default_value[:3])
    place = wires.vector("MULTIPLY", wires.node("ShaderNodeNewGeometry").outputs["Position"], (1.0, 1.0, 0.0))
    away = wires.vector("DISTANCE", place, (middle.x, middle.y, 0.0))
    beyond = wires.smooth_step(away, SWEEP[0] * size, SWEEP[1] * size)
    bounced = wires.node("ShaderNodeLightPath").outputs["Is Diffuse Ray"]
    paper = wires.shader("BsdfDiffuse", wires.mix(bounced, paint, DIM * paint))
    wires.show(wires.shader("MixShader", beyond, paper, wires.shader("BsdfTransparent")))


def main(arguments: Sequence[str]) -> None:
    """Dress the open scene, or the stage that is named after `--`."""
    if arguments:
        import_stage(arguments[0])
    else:
        dress(bpy.context.scene)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
