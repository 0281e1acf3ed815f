"""The pressure of a latex balloon that is blown up: why it is hardest at the start.

A ball of latex is pumped up slowly. Its pressure is drawn by its stretch, beside the formula for a sphere.
"""

import numpy as np
import trimesh
from matplotlib import pyplot as plt

import balloon_warp as bw

FRAMES = 120
RADIUS, THICKNESS = 0.05, 2e-4  # [m]
C1, C2 = 1.5e5, 1.5e4  # of latex [Pa]

balloon = bw.Balloon(
    mesh=trimesh.creation.icosphere(subdivisions=2, radius=RADIUS),
    material=bw.Material(preset="latex"),
    inflation=bw.Inflation(kind="gas", start_pressure=0.0, pump=[(0.0, 0.02), (0.4, 0.02), (2.0, 2.0)]),  # [mol/s]
    damping=0.1,
)
moved = bw.simulate(bw.Scene(balloon=[balloon], gravity=0.0, frames=FRAMES))
stretch = np.cbrt(moved.volumes[:, 0] / moved.volumes[0, 0])
pressure = moved.pressures[:, 0]
formula = 4.0 * THICKNESS / RADIUS * (1.0 / stretch - stretch**-7.0) * (C1 + C2 * stretch**2.0)

plt.style.use("balloon_warp.studio.charts")
plt.plot(stretch, pressure, ".", label="simulated")
plt.plot(stretch, formula, color="C5", zorder=1, label="formula of a sphere")
plt.xlabel("stretch")
plt.ylabel("pressure [Pa]")
plt.legend()
plt.savefig("pressure_curve.png")
