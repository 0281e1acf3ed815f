"""Find the throw by which a balloon bounces into a target: two numbers, through contact with the ground.

A ball of springs with a sealed gas flies down, bounces on the ground, and is to be at the target in the end. Four
starts go down along their gradients, as worlds of one batch; the best is kept.
"""

import numpy as np
from trimesh.creation import icosphere

import balloon_warp as bw

STARTS = 4
TARGET = (0.4, 0.25, 0.0)  # [m]
THROW = {"balloon.velocity.0": (0.2, 3.0), "balloon.velocity.1": (-6.0, -1.0)}  # [m/s]

ball = bw.Balloon(
    mesh=icosphere(subdivisions=1, radius=0.1), mass=0.05, position=(0.0, 0.4, 0.0), damping=0.0,
    inflation=bw.Inflation(kind="gas", start_pressure=200.0),
)  # fmt: skip
scene = bw.Scene(balloon=[ball], ground=bw.Ground(friction=0.3), frames=18, substeps=48)

found = bw.fit(scene, of=THROW, loss=bw.losses.distance(TARGET), starts=STARTS)
print(found)
print("what each start came to, as a distance [m]:", np.round(np.sqrt(found.starts), 4))

moved = bw.simulate(bw.load_scene(scene, found.values))
path = moved.points[0].mean(axis=1)
print(f"its lowest particle was at {moved.points[0][..., 1].min():.3f} m, it ends at {np.round(path[-1], 3)}")
