"""Add-on: the part of the extension that Blender loads. It needs nothing but `bpy` and NumPy, which Blender has.

A bake goes from `panel` to `baking`, `reading` and `request`, which needs no `bpy`, and comes back through `modifiers`.
"""


def register() -> None:
    """Register the add-on, as Blender enables the extension."""
    from .panel import register  # needs bpy

    register()


def unregister() -> None:
    """Unregister the add-on, as Blender disables the extension; the .blend keeps its properties."""
    from .panel import unregister

    unregister()
