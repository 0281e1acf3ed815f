"""The panel "Balloon" in the sidebar of the 3D view: its rows, its buttons, and how Blender comes to know them."""

import atexit
import textwrap
from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent
from bpy.types import Context, Object, Operator, Panel, Scene, UILayout

from . import baking, modifiers, properties
from .request import RefusedError
from .studio_look import can_dress, dress

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
    layout.operator("balloon.preview", text="Stop Preview" if baking.previewing else "Preview", icon="PLAY")
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


class BalloonOperator(Operator):
    """Operator that reports a refusal in one sentence, and keeps it on the panel."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def tried(self, context: Context, act: Callable[[], object], done: str = "") -> set[str]:
        """Act, and return the operator's result."""
        try:
            act()
        except RefusedError as refusal:
            baking.say(context.scene, str(refusal), is_error=True)
            self.report({"ERROR"}, str(refusal))
            return {"CANCELLED"}
        baking.say(context.scene, done)
        return {"FINISHED"}


class BALLOON_OT_inflate(BalloonOperator):  # noqa: N801
    """Make a balloon of each selected mesh."""

    bl_idname = "balloon.inflate"
    bl_label = "Inflate"
    bl_description = "Make a balloon of each selected mesh"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return context.mode == "OBJECT" and any(each.type == "MESH" for each in context.selected_objects)

    def execute(self, context: Context) -> set[str]:
        def act() -> None:
            for each in context.selected_objects:
                if each.type == "MESH":
                    if not each.is_editable:
                        raise RefusedError(
                            f"{each.name}: is linked from another file; expected a library override of it"
                        )
                    properties.of(each).role = "BALLOON"
                    modifiers.add(each)

        return self.tried(context, act, "Press Bake")


class BALLOON_OT_remove(BalloonOperator):  # noqa: N801
    """Take the balloon away; the mesh stays as it was."""

    bl_idname = "balloon.remove"
    bl_label = "Remove Balloon"
    bl_description = "Take the balloon away; the mesh stays as it was"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return context.object is not None and properties.of(context.object).role != "NONE" and not baking.running

    def execute(self, context: Context) -> set[str]:
        def act() -> None:
            modifiers.remove(context.object)
            properties.of(context.object).role = "NONE"

        return self.tried(context, act)


class BALLOON_OT_bake(BalloonOperator):  # noqa: N801
    """Simulate all balloons of the scene, in a process of its own."""

    bl_idname = "balloon.bake"
    bl_label = "Bake"
    bl_description = "Simulate all balloons of the scene, in a process of its own"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return not baking.running

    def execute(self, context: Context) -> set[str]:
        def act() -> None:
            baking.stop_preview()
            baking.start(context)

        return self.tried(context, act, "Preparing")


class BALLOON_OT_preview(BalloonOperator):  # noqa: N801
    """Play all balloons of the scene live, or stop that."""

    bl_idname = "balloon.preview"
    bl_label = "Preview"
    bl_description = "Play all balloons live while values are dragged; again to stop"
    bl_options = {"REGISTER"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Context) -> bool:
        return not baking.running

    def execute(self, context: Context) -> set[str]:
        return self.tried(context, baking.stop_preview if baking.previewing else lambda: baking.start_preview(context))


class BALLOON_OT_resume(BalloonOperator):  # noqa: N801
    """Go on with a bake that was cancelled or ended."""

    bl_idname = "balloon.resume"
    bl_label = "Continue"
    bl_description = "Go on with a bake that was cancelled or ended"
    bl_options = {"REGISTER"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Context) -> bool:
        return baking.can_continue(context.scene)

    def execute(self, context: Context) -> set[str]:
        return self.tried(context, lambda: baking.resume(context.scene), "Preparing")


class BALLOON_OT_cancel(BalloonOperator):  # noqa: N801
    """Stop the bake; its frames stay, and it can go on later."""

    bl_idname = "balloon.cancel"
    bl_label = "Cancel"
    bl_description = "Stop the bake; its frames stay, and it can go on later"
    bl_options = {"REGISTER"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Context) -> bool:
        return baking.running is not None

    def execute(self, context: Context) -> set[str]:
        if baking.running:
            baking.running.cancel()
        return {"FINISHED"}


class BALLOON_OT_delete(BalloonOperator):  # noqa: N801
    """Delete the bake and its files; the objects are as before."""

    bl_idname = "balloon.delete"
    bl_label = "Delete Bake"
    bl_description = "Delete the bake and its files; the objects are as before"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return not baking.running and (bool(modifiers.caches_of(context.scene)) or baking.can_continue(context.scene))

    def execute(self, context: Context) -> set[str]:
        return self.tried(context, lambda: baking.delete(context.scene))


class BALLOON_OT_dress(BalloonOperator):  # noqa: N801
    """Give a stage that was imported the look of Balloon Warp's own pictures, in Cycles."""

    bl_idname = "balloon.dress"
    bl_label = "Studio Look"
    bl_description = "Thin latex, softboxes and a backdrop for a stage of Balloon Warp that was imported, in Cycles"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return can_dress(context.scene)

    def execute(self, context: Context) -> set[str]:
        return self.tried(context, lambda: dress(context.scene))


@persistent
def before_load(*_: object) -> None:
    """End the bake, or the preview, of a file that is closed."""
    baking.stop_all()


@persistent
def before_save(path: str, *_: object) -> None:
    """End a preview, and take bakes along when a file is saved first."""
    baking.stop_preview()
    baking.move_beside(path)


@persistent
def after_save(path: str, *_: object) -> None:
    """Keep the bake of a file of which a copy was saved."""
    baking.stay_with_copy(path)


@persistent
def after_undo(scene: Scene, *_: object) -> None:
    """Show the current bake, which is newer than the state that undo restored."""
    modifiers.refresh(scene)


CLASSES = (
    BALLOON_OT_inflate,
    BALLOON_OT_remove,
    BALLOON_OT_bake,
    BALLOON_OT_preview,
    BALLOON_OT_resume,
    BALLOON_OT_cancel,
    BALLOON_OT_delete,
    BALLOON_OT_dress,
    BALLOON_PT_balloon,
    BALLOON_PT_surroundings,
)
HANDLERS = (
    (bpy.app.handlers.load_pre, before_load),
    (bpy.app.handlers.save_pre, before_save),
    (bpy.app.handlers.save_post, after_save),
    (bpy.app.handlers.undo_post, after_undo),
    (bpy.app.handlers.redo_post, after_undo),
)


def register() -> None:
    """Register the add-on, as Blender enables the extension."""
    properties.register()
    for each in CLASSES:
        bpy.utils.register_class(each)
    for handlers, act in HANDLERS:
        handlers.append(act)
    atexit.register(baking.stop_all)


def unregister() -> None:
    """Unregister the add-on, as Blender disables the extension; the .blend keeps its properties."""
    baking.stop_all()
    atexit.unregister(baking.stop_all)
    for handlers, act in HANDLERS:
        handlers.remove(act)
    for watch in (baking.watch, baking.watch_preview):
        if bpy.app.timers.is_registered(watch):
            bpy.app.timers.unregister(watch)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    properties.unregister()
