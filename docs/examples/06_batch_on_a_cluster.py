"""A batch on a cluster of two processes of this machine.

`bw.Cluster(gpus=4)` takes GPUs instead, and `bw.Cluster(address="tcp://HOST:8786")` the workers of a Dask scheduler.
The files are those of one process.
"""

import numpy as np

import balloon_warp as bw

WORLDS = 64
FRAMES = 60


def main() -> None:
    """Workers import this file: what they are not to run themselves stands in a function."""
    scene = bw.load_scene("squirrel_tether", {"frames": FRAMES})
    lifts = np.linspace(8.0, 16.0, WORLDS)  # [N/kg]
    bw.run_batch(scene, "lifts", WORLDS, {"balloon.helium": lifts}, cluster=bw.Cluster(workers=2))
    table = np.load("lifts/table.npz")
    print({name: table[name].shape for name in table.files})


if __name__ == "__main__":
    main()
