"""Precompiled headers that processes share."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMPILE_THREE = """
import sys
from pathlib import Path
import warp as wp
wp.config.optimization_level = 0
from balloon_warp.temporaries import folder_of_process
from balloon_warp.warp_logging import quiet_warp
quiet_warp()
for number in (float(sys.argv[1]) + part for part in (0.0, 0.25, 0.5)):
    @wp.kernel(module="unique", enable_backward=False)
    def count(a: wp.array(dtype=float)):
        a[wp.tid()] = wp.static(number)
    a = wp.zeros(1, device="cpu")
    wp.launch(count, 1, [a], device="cpu")
assert a.numpy()[0] == number
print(*("found" if each.is_symlink() else "made" for each in folder_of_process().rglob("*.pch")))
"""


@pytest.mark.full
def test_a_process_finds_the_headers_that_another_has_compiled(tmp_path: Path):
    """The first process makes them, the second finds them; one that finds them spoilt makes them again, for others."""
    script = tmp_path / "compile.py"
    script.write_text(COMPILE_THREE)
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path / "cache")}

    def told(number: float) -> str:
        command = [sys.executable, str(script), str(number)]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.strip()

    assert told(2.0) == "made"
    assert told(3.0) == "found"
    (shared,) = (tmp_path / "cache").rglob("*.pch")
    whole = shared.stat().st_size
    shared.write_bytes(b"spoilt")
    assert told(4.0) == "made"
    assert shared.stat().st_size == whole
    assert told(5.0) == "found"
    assert [path.name for path in shared.parent.iterdir()] == [shared.name]
