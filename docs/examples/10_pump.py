"""Find the pump curve that holds a balloon at a height: four numbers, through gas, buoyancy and drag.

A balloon of helium that is a little too heavy falls, and is to be back at a height of 1 m, and to stay there. The
pump's rate at four times is found along gradients.
"""

from trimesh.creation import icosphere

import balloon_warp as bw

HEIGHT = 1.0  # [m]
TIMES = (0.0, 0.5, 1.0, 1.5)  # [s]
PUMP = {f"balloon.0.inflation.pump.{key}.1": (-4.0, 8.0) for key in range(len(TIMES))}  # [mol/s]

helium = bw.Inflation(kind="gas", start_pressure=20.0, pump=[(time, 0.0) for time in TIMES])
balloon = bw.Balloon(
    mesh=icosphere(subdivisions=1, radius=0.3), position=(0.0, HEIGHT, 0.0), velocity=(0.0, -0.1, 0.0), mass=0.12,
    stiffness={"structural": 20.0}, damping=0.05, drag_coefficient=0.5, inflation=helium,
)  # fmt: skip
scene = bw.Scene(balloon=[balloon], frames=36, frames_per_second=24.0, substeps=16)

found = bw.fit(scene, of=PUMP, loss=bw.losses.height(HEIGHT, frame=None), starts=1)
print(found)
left, held = (bw.simulate(bw.load_scene(scene, values)).points[0][..., 1].mean(axis=1) for values in ({}, found.values))
print(f"without a pump it ends at {left[-1]:.3f} m")
print(f"with it, it is at {held.min():.3f} to {held.max():.3f} m, and ends at {held[-1]:.3f} m")
