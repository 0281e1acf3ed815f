"""The add-on: what Blender loads of the extension. It needs nothing but `bpy` and NumPy, which Blender has.

What makes a request of numbers needs no `bpy`, and runs without Blender.
"""


def register() -> None:
    """Register the add-on, as Blender enables the extension."""
    from .registering import register  # needs bpy

    register()


def unregister() -> None:
    """Unregister the add-on, as Blender disables the extension; what the .blend keeps stays."""
    from .registering import unregister

    unregister()
