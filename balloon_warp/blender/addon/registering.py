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


@persistent
def after_save(path: str, *_: object) -> None:
    """Keep the bake of a file of which a copy was saved."""
    baking.stay_with_copy(path)


@persistent
def after_undo(scene: bpy.types.Scene, *_: object) -> None:
    """Show the bake as it is, which is newer than what undo knows of it."""
    baking.show(scene)


HANDLERS = (
    (bpy.app.handlers.load_pre, before_load),
    (bpy.app.handlers.save_pre, before_save),
    (bpy.app.handlers.save_post, after_save),
    (bpy.app.handlers.undo_post, after_undo),
    (bpy.app.handlers.redo_post, after_undo),
)


def register() -> None:
    """Register all parts, as Blender enables the extension."""
    for part in PARTS:
        part.register()
    for handlers, act in HANDLERS:
        handlers.append(act)
    atexit.register(stop)


def unregister() -> None:
    """Unregister all parts, as Blender disables the extension; the .blend keeps its properties."""
    stop()
    atexit.unregister(stop)
    for handlers, act in HANDLERS:
        handlers.remove(act)
    for watch in (baking.watch, preview.watch):
        if bpy.app.timers.is_registered(watch):
            bpy.app.timers.unregister(watch)
    for part in reversed(PARTS):
        part.unregister()
