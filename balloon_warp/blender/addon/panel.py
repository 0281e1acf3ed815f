"""The panel "Balloon" in the sidebar of the 3D view."""

import textwrap

import bpy
from bpy.types import Context, Object, Panel, UILayout

from . import baking, preview, properties
from .studio_look import can_dress

LINE = 40
"""Letters in a line of a message"""


class BALLOON_PT_balloon(Panel):  # noqa: N801 (Blender's rule)
    """Panel of the active object's role in the simulation, and of the bake."""

    bl_label = "Balloon"
    bl_category = "Balloon"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    def draw(self, context: Context) -> None:
        """Draw the panel."""
        self.layout.use_property_split = True
        thing = context.object
        if thing and thing.type == "MESH":
            draw_object(self.layout, thing)
        if can_dress(context.scene):
            self.layout.operator("balloon.dress", icon="LIGHT")
        draw_bake(self.layout, context)


class BALLOON_PT_surroundings(Panel):  # noqa: N801
    """Surroundings of all balloons of the scene."""

    bl_label = "Surroundings"
    bl_category = "Balloon"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 (Blender reads it from the class)

    def draw(self, context: Context) -> None:
        """Draw the panel."""
        layout, settings = self.layout, properties.of(context.scene)
        layout.use_property_split = True
        layout.prop(settings, "ground")
        if settings.ground:
            layout.prop(settings, "ground_height")
        layout.prop(settings, "touch")
        if settings.touch:
            layout.prop(settings, "quality")
        layout.prop(context.scene, "use_gravity")


def draw_object(layout: UILayout, thing: Object) -> None:
    """Draw the properties of an object, as far as its role has them."""
    settings = properties.of(thing)
    if settings.role == "NONE":
        layout.operator("balloon.inflate", icon="SPHERE")
    layout.prop(settings, "role")
    for name in shown_properties(settings):
        if name == "pinned":
            layout.prop_search(settings, name, thing, "vertex_groups")
        else:
            layout.prop(settings, name)
    if settings.role != "NONE":
        layout.operator("balloon.remove", icon="X")


def shown_properties(settings: properties.ObjectProperties) -> list[str]:
    """Return the names of the properties that count, in order."""
    if settings.role in ("NONE", "OBSTACLE"):
        return ["friction"] if settings.role == "OBSTACLE" else []
    if settings.role == "BODY":
        return ["mass", "friction"]
    springs = ["stiffness", "mass"] if settings.material == "SPRINGS" else []
    amount = {
        "VOLUME": ["volume", "lift"],
        "PRESSURE": ["pressure", "lift"],
        "LITRES": ["litres", "fill_time", "filling"],
    }[settings.inflate]
    bursts = [] if settings.material == "SPRINGS" else ["burst"]
    if bursts and settings.burst != "NEVER":
        bursts += ["strength"] if settings.burst == "STRESS" else ["strength", "burst_frame"]
    held = ["pinned", "string"]
    return ["material", *springs, "inflate", *amount, *bursts, "drag", "damping", "friction", *held]


def draw_bake(layout: UILayout, context: Context) -> None:
    """Draw the buttons of the bake, and its message."""
    settings, bake = properties.of(context.scene), baking.running
    if bake:
        layout.progress(factor=bake.frame / bake.frames, text=settings.message)
        layout.operator("balloon.cancel", icon="CANCEL")
        return
    layout.operator("balloon.preview", text="Stop Preview" if preview.running else "Preview", icon="PLAY")
    layout.operator("balloon.bake", icon="PHYSICS")
    if baking.can_continue(context.scene):
        layout.operator("balloon.resume", icon="FF")
    layout.operator("balloon.delete", icon="TRASH")
    write(layout, settings.message, "ERROR" if settings.is_error else "NONE")
    for remark in settings.remarks.splitlines():
        write(layout.box(), remark, "INFO")


def write(layout: UILayout, text: str, icon: str) -> None:
    """Write a text in lines, the first with an icon."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, LINE)):
        column.label(text=line, icon=icon if not number else "BLANK1")


CLASSES = (BALLOON_PT_balloon, BALLOON_PT_surroundings)


def register() -> None:
    """Register the panel."""
    for each in CLASSES:
        bpy.utils.register_class(each)


def unregister() -> None:
    """Unregister the panel."""
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
