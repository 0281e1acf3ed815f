"""Reading results with pandas: how high a pillow throws a sphere, by its mass.

A batch writes a table with a row for each world and frame.
"""

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt

import balloon_warp as bw

FRAMES = 120

scene = bw.load_scene("sphere_launch", {"frames": FRAMES})
masses = np.array([1.0, 3.0, 10.0, 30.0, 100.0, 300.0])  # of the sphere [kg]
bw.run_batch(scene, "spheres", len(masses), {"sphere.0.mass": masses})

table = pd.read_csv("spheres/table.csv")
print(table.columns.tolist())
by_mass = table.groupby("sphere.0.mass").agg(
    highest=("sphere_0_height", "max"), most_stretch=("largest_stretch", "max"), health=("health", "min")
)
print(by_mass.round(3))

plt.style.use("balloon_warp.studio.charts")
table.pivot(index="time", columns="sphere.0.mass", values="sphere_0_height").plot()
plt.ylabel("height of the sphere [m]")
plt.xlabel("time [s]")
plt.legend(title="sphere [kg]", fontsize=8)
plt.savefig("pandas.png")
