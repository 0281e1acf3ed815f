"""Registering of the add-on with Blender."""

import atexit

import bpy
from bpy.app.handlers import persistent

from . import baking, operators, panel, preferences, preview, properties

PARTS = (preferences, properties, operators, panel)


def stop() -> None:
    """End a bake or a preview that runs."""
    preview.stop()
    baking.stop()


@persistent
def before_load(*_: object) -> None:
    """End the bake, or the preview, of a file that is closed."""
    stop()


@persistent
def before_save(path: str, *_: object) -> None:
    """End a preview, and take bakes along when a file is saved first."""
    preview.stop()
    baking.move_beside(path)


def register() -> None:
    """Register all parts, as Blender enables the extension."""
    for part in PARTS:
        part.register()
    bpy.app.handlers.load_pre.append(before_load)
    bpy.app.handlers.save_pre.append(before_save)
    atexit.register(stop)


def unregister() -> None:
    """Unregister all parts, as Blender disables the extension; the .blend keeps its properties."""
    stop()
    atexit.unregister(stop)
    bpy.app.handlers.load_pre.remove(before_load)
    bpy.app.handlers.save_pre.remove(before_save)
    for watch in (baking.watch, preview.watch):
        if bpy.app.timers.is_registered(watch):
            bpy.app.timers.unregister(watch)
    for part in reversed(PARTS):
        part.unregister()
