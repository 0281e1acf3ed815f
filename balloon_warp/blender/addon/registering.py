"""Registering of the add-on with Blender."""

import atexit

import bpy
from bpy.app.handlers import persistent

from . import baking, operators, panel, preferences, properties

PARTS = (preferences, properties, operators, panel)


@persistent
def before_load(*_: object) -> None:
    """End the bake of a file that is closed."""
    baking.stop()


@persistent
def before_save(path: str, *_: object) -> None:
    """Take bakes along when a file is saved first."""
    baking.move_beside(path)


def register() -> None:
    """Register all parts, as Blender enables the extension."""
    for part in PARTS:
        part.register()
    bpy.app.handlers.load_pre.append(before_load)
    bpy.app.handlers.save_pre.append(before_save)
    atexit.register(baking.stop)


def unregister() -> None:
    """Unregister all parts, as Blender disables the extension; what the .blend keeps stays."""
    baking.stop()
    atexit.unregister(baking.stop)
    bpy.app.handlers.load_pre.remove(before_load)
    bpy.app.handlers.save_pre.remove(before_save)
    if bpy.app.timers.is_registered(baking.watch):
        bpy.app.timers.unregister(baking.watch)
    for part in reversed(PARTS):
        part.unregister()
