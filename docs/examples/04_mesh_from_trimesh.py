"""A mesh from trimesh: a ring that is inflated, as a stage and a picture.

Any library's points and faces will do. A mesh by itself gets a scene around it, as a file does.
"""

import trimesh

import balloon_warp as bw

FRAMES = 60
SECTIONS = 48

ring = trimesh.creation.torus(
    major_radius=0.4, minor_radius=0.12, major_sections=SECTIONS, minor_sections=SECTIONS // 2
)
scene = bw.load_scene(ring, {"frames": FRAMES})
summary = bw.animate(scene, "ring.usdc", picture="ring.png")
print(f"{summary.particles} particles, {summary.frames} frames, {summary.wall_seconds:.1f} s")
