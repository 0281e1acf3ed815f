"""A sweep with a plot: how much a squirrel holds, by its pressure.

All worlds are simulated side by side. One of them differs from the next in the pressure alone.
"""

import numpy as np
from matplotlib import pyplot as plt

import balloon_warp as bw

WORLDS = 32
FRAMES = 90

scene = bw.load_scene(
    "squirrel_inflate", {"frames": FRAMES, "balloon.inflation": {"kind": "pressure", "pressure": 1.0}}
)
pressures = np.linspace(0.0, 400.0, WORLDS)  # [Pa]
moved = bw.simulate(scene, world_count=WORLDS, vary={"balloon.inflation.pressure": pressures})
volumes = 1000.0 * moved.volumes[:, -1, 0]  # of each world, after the last frame, of the first balloon [L]

plt.style.use("balloon_warp.studio.charts")
plt.plot(pressures, volumes, "o-")
plt.xlabel("pressure [Pa]")
plt.ylabel("volume [L]")
plt.savefig("sweep.png")
