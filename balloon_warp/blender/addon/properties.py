"""Properties of objects and scenes, which the .blend keeps and undo knows, and the preferences of the extension."""

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty
from bpy.types import AddonPreferences, Context, Object, PropertyGroup

NAME = "balloon_warp"
"""Name of the properties of objects and scenes"""
ROLES = (
    ("NONE", "None", "Takes no part"),
    ("BALLOON", "Balloon", "Is inflated"),
    ("OBSTACLE", "Obstacle", "Balloons cannot enter it; it moves as it is animated"),
    ("BODY", "Body", "Falls and turns freely; balloons push and carry it"),
)
MATERIALS = (
    ("SPRINGS", "Springs", "Springs along and across faces"),
    ("LATEX", "Latex", "The rubber of toy balloons, 0.2 mm"),
    ("LATEX_THICK", "Thick Latex", "The rubber of large balloons, 0.5 mm"),
    ("NATURAL_RUBBER_TRELOAR", "Natural Rubber", "Measured by Treloar"),
    ("FOIL", "Foil", "Polyester film of 12 micrometers"),
    ("NYLON", "Nylon", "Nylon film of 15 micrometers"),
)
INFLATIONS = (
    ("VOLUME", "Volume", "A pressure that gives about this volume"),
    ("PRESSURE", "Pressure", "A given pressure, which may be animated"),
    ("LITRES", "Litres", "A sealed amount of gas, which has its own weight and lift"),
)
FILLINGS = (("HELIUM", "Helium", "Rises"), ("AIR", "Air", "Falls"))
BURSTS = (
    ("NEVER", "Never", "The skin holds"),
    ("STRESS", "When Overstretched", "Where its stress reaches its strength"),
    ("NEEDLE", "At a Frame", "A needle pierces it there, at the latest"),
)
QUALITIES = (
    ("GOOD", "Good", "Faces touch particles"),
    ("FINE", "Fine", "Edges touch edges, too: slower"),
)
OVERRIDABLE: dict[str, Any] = {"override": {"LIBRARY_OVERRIDABLE"}}
"""Options of a property that overrides of linked objects keep"""
STAYS: dict[str, Any] = OVERRIDABLE | {"options": set()}
"""Options of one that cannot be animated, besides"""


def is_empty(_: object, chosen: Object) -> bool:
    """Return whether an object can be an anchor."""
    return chosen.type == "EMPTY"


class ObjectProperties(PropertyGroup):
    """Role of an object in the simulation, and its values."""

    role: EnumProperty(name="Role", items=ROLES, **STAYS)
    material: EnumProperty(name="Material", items=MATERIALS, **STAYS)
    stiffness: FloatProperty(
        name="Stiffness", description="Spring constant [N/m]", default=80.0, min=0.0, soft_max=1000.0, **STAYS
    )
    inflate: EnumProperty(name="Inflate To", items=INFLATIONS, **STAYS)
    volume: FloatProperty(
        name="Volume", description="Volume over that of the mesh", default=2.0, min=1.0, max=8.0, **OVERRIDABLE
    )
    pressure: FloatProperty(
        name="Pressure",
        description="Pressure above that of the air [Pa]",
        default=100.0,
        soft_min=0.0,
        soft_max=1000.0,
        **OVERRIDABLE,
    )
    litres: FloatProperty(
        name="Litres", description="Gas blown in, at the air's pressure [l]", default=10.0, min=0.0, **OVERRIDABLE
    )
    fill_time: FloatProperty(name="Within", description="Duration of the filling [s]", default=1.0, min=0.01, **STAYS)
    filling: EnumProperty(name="Gas", items=FILLINGS, **STAYS)
    mass: FloatProperty(name="Mass", default=0.1, min=1e-6, soft_max=10.0, precision=3, unit="MASS", **STAYS)
    lift: FloatProperty(
        name="Helium Lift",
        description="Upward acceleration [m/s^2]; the balloon rises where it is above gravity",
        default=9.0,
        soft_min=0.0,
        soft_max=20.0,
        **STAYS,
    )
    drag: FloatProperty(
        name="Wind Drag",
        description="Drag coefficient where there is wind; that of a sphere is 0.5",
        default=0.5,
        min=0.0,
        soft_max=2.0,
        **STAYS,
    )
    damping: FloatProperty(
        name="Damping", description="Damping of any motion [N s/m]", default=0.1, min=0.0, soft_max=1.0, **STAYS
    )
    friction: FloatProperty(name="Friction", default=0.5, min=0.0, soft_max=1.0, **STAYS)
    pinned: StringProperty(name="Pin Group", description="Vertex group that moves as it is animated", **STAYS)
    string: PointerProperty(
        name="String", description="Empty to which the balloon is tied", type=Object, poll=is_empty, **OVERRIDABLE
    )
    burst: EnumProperty(name="Burst", items=BURSTS, **STAYS)
    strength: FloatProperty(
        name="Strength",
        description="Stress at which the skin tears [MPa]; that of latex is 20 to 30",
        default=10.0,
        min=0.01,
        soft_max=100.0,
        **STAYS,
    )
    burst_frame: IntProperty(name="Frame", description="Frame in which a needle pierces it", default=24, **STAYS)


class SceneProperties(PropertyGroup):
    """Surroundings of balloons, and the state of their bake."""

    ground: BoolProperty(name="Ground", description="Level ground", default=False, options=set())
    ground_height: FloatProperty(name="Height", description="Height of the ground", unit="LENGTH", options=set())
    touch: BoolProperty(name="Touch", description="Balloons touch each other", default=True, options=set())
    quality: EnumProperty(name="Contact", items=QUALITIES, options=set())
    message: StringProperty(name="Message", options=set())
    remarks: StringProperty(name="Remarks", options=set())
    is_error: BoolProperty(options=set())


class Preferences(AddonPreferences):
    """Preferences of the extension: the place of Balloon Warp, if it is not in the zip."""

    bl_idname = __package__

    python: StringProperty(
        name="Python",
        description="Python of an environment with balloon-warp; when empty, Blender's own with the extension's wheels",
        subtype="FILE_PATH",
    )

    def draw(self, _: Context) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "python")


CLASSES = (Preferences, ObjectProperties, SceneProperties)


def of(owner: bpy.types.ID) -> ObjectProperties | SceneProperties:
    """Return the properties of an object or a scene."""
    return getattr(owner, NAME)


def amount_of(inflation: str) -> str:
    """Return the property that says how far a balloon is inflated."""
    return inflation.lower()


def python() -> str:
    """Return the path of the Python that is to bake, empty for Blender's own."""
    added = bpy.context.preferences.addons.get(__package__)
    return bpy.path.abspath(added.preferences.python) if added and added.preferences else ""


def register() -> None:
    """Give objects, scenes and the extension their properties."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    setattr(Object, NAME, PointerProperty(type=ObjectProperties, **OVERRIDABLE))
    setattr(bpy.types.Scene, NAME, PointerProperty(type=SceneProperties))


def unregister() -> None:
    """Take the properties away; the .blend keeps the values."""
    for owner in (bpy.types.Scene, Object):
        delattr(owner, NAME)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
