"""Extension of Blender: a panel that makes balloons of mesh objects, and bakes them in a process of its own.

`addon` is what runs within Blender, with its `bpy` and NumPy alone: it writes a request. `bake` is the process: it
reads the request, simulates, and writes point caches, which Blender plays while they grow. `extension` builds the zip.
"""
