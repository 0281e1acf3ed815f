"""Buttons of the panel."""

from collections.abc import Callable

import bpy
from bpy.types import Context, Operator

from . import baking, modifiers, preview, properties, tears
from .snapshot import RefusedError
from .studio_look import can_dress, dress


class BalloonOperator(Operator):
    """Operator that reports a refusal in one sentence, and keeps it on the panel."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 (Blender reads it from the class)

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


class BALLOON_OT_inflate(BalloonOperator):  # noqa: N801 (Blender's rule)
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
                    baking.inflate(each)

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
            tears.remove(context.object)
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
            preview.stop()
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
        return self.tried(context, preview.stop if preview.running else lambda: preview.start(context))


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


CLASSES = (
    BALLOON_OT_inflate,
    BALLOON_OT_remove,
    BALLOON_OT_bake,
    BALLOON_OT_preview,
    BALLOON_OT_resume,
    BALLOON_OT_cancel,
    BALLOON_OT_delete,
    BALLOON_OT_dress,
)


def register() -> None:
    """Register the buttons."""
    for each in CLASSES:
        bpy.utils.register_class(each)


def unregister() -> None:
    """Unregister the buttons."""
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
