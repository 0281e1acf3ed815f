"""Pictures of docs/, made again.

Run it by python -m balloon_warp.scenes.gallery docs/pictures.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from balloon_warp import animate, bundled_scenes, compare, load_scene, render_stage, run_batch

SIZE = (640, 360)
SAMPLES = 16
MOVING = {"foil_letters": {"frames": (0, 119), "frames_per_second": 20.0}}
"""scenes of which there is an animation, too, and which part of them it shows"""


def main(folder: Path) -> None:
    """Simulate each bundled scene, a correction and none side by side, and a batch; write their pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as stages:
        for name in bundled_scenes():
            stage = Path(stages) / f"{name}.usdc"
            animate(load_scene(name), stage)
            render_stage(stage, folder / f"{name}.png", size=SIZE, samples=SAMPLES)
            if name in MOVING:
                render_stage(stage, folder / f"{name}.webp", size=SIZE, **MOVING[name])
            print(f"wrote {folder / name}.png", flush=True)
        compare(load_scene("turtle_provot"), {"correction": ["none", "provot"]}, folder / "correction.png")
        inflation = np.linspace(0.5, 8.0, 9)
        batch = load_scene("squirrel_inflate", [("frames", 90)])
        run_batch(batch, stages, len(inflation), {"balloon.inflation.k_normal": inflation}, export=range(9))
        render_stage(Path(stages) / "worlds.usdc", folder / "batch.png", size=SIZE, samples=SAMPLES)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures"))
