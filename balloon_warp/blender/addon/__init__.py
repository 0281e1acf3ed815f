"""Add-on: the part of the extension that Blender loads. It needs nothing but `bpy` and NumPy, which Blender has.

The modules `request` and `snapshot` need no `bpy`, and run without Blender.
"""


def register() -> None:
    """Register the add-on, as Blender enables the extension."""
    from .registering import register  # needs bpy

    register()


def unregister() -> None:
    """Unregister the add-on, as Blender disables the extension; the .blend keeps its properties."""
    from .registering import unregister

    unregister()
