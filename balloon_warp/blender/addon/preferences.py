"""Preferences: which Python bakes."""

import bpy
from bpy.props import StringProperty
from bpy.types import AddonPreferences


class Preferences(AddonPreferences):
    """Preferences of the extension: the place of Balloon Warp, if it is not in the zip."""

    bl_idname = __package__

    python: StringProperty(
        name="Python",
        description="Python of an environment with balloon-warp; when empty, Blender's own with the extension's wheels",
        subtype="FILE_PATH",
    )

    def draw(self, _: bpy.types.Context) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "python")


def python() -> str:
    """Return the path of the Python that is to bake, empty for Blender's own."""
    added = bpy.context.preferences.addons.get(__package__)
    return bpy.path.abspath(added.preferences.python) if added and added.preferences else ""


def register() -> None:
    """Register the preferences."""
    bpy.utils.register_class(Preferences)


def unregister() -> None:
    """Unregister the preferences."""
    bpy.utils.unregister_class(Preferences)
