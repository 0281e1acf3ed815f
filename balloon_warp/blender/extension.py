"""Zip of the extension, which Blender installs: the add-on, its manifest, and wheels of all that a bake needs.

Blender's rules: https://docs.blender.org/manual/en/latest/advanced/extensions/getting_started.html
"""

import base64
import hashlib
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from balloon_warp.errors import InputError
from balloon_warp.scene.fields import toml_value
from balloon_warp.system.files import check_writable, whole_file

ADDON = Path(__file__).parent / "addon"
STUDIO_LOOK = ADDON / "studio_look.py"
NEEDED = ("warp-lang", "scipy", "pydantic", "typing-extensions")
"""Requirements of a bake; Blender has NumPy, and a USD of its own, which another one beside it would break"""
PLATFORMS = {
    "linux-x64": [f"manylinux_2_{minor}_x86_64" for minor in range(34, 16, -1)] + ["manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": ["macosx_15_0_arm64"],
}
"""Tags of wheels, by Blender's names of platforms"""
PYTHON = "3.11"
"""Python of Blender 4.2 to 5.0"""
NUMPY = "numpy<2"
"""Version that wheels must work with: Blender's"""
MANIFEST = {
    "schema_version": "1.0.0",
    "id": "balloon_warp",
    "name": "Balloon Warp",
    "tagline": "Inflate meshes: balloons of rubber, foil and gas",
    "maintainer": "Balloon Warp",
    "type": "add-on",
    "blender_version_min": "4.2.0",
    "license": ["SPDX:Apache-2.0"],
    "tags": ["Physics", "Animation"],
}
WHEEL = b"Wheel-Version: 1.0\nGenerator: balloon-warp\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
"""Metadata file of a wheel"""
PERMISSIONS = {"files": "Write the caches of bakes beside the blend file"}


def write_extension(path: Path, platforms: Sequence[str] | None = None, wheels: bool = True) -> Path:
    """Write the extension's zip.

    Args:
        path: of the zip.
        platforms: whose wheels it has; that of this machine, if not given.
        wheels: whether it has any; without them its preferences name an environment with Balloon Warp.

    Raises:
        InputError: the zip cannot be written, there is no such platform, or pip cannot download a wheel.
    """
    check_writable(path, (".zip",))
    platforms = list(platforms or [own_platform()])
    for platform in platforms:
        if platform not in PLATFORMS:
            raise InputError(f"--platform: expected one of {', '.join(PLATFORMS)} (got {platform})")
    with TemporaryDirectory() as folder, whole_file(path) as temporary:
        if wheels:
            write_own_wheel(Path(folder))
            for platform in platforms:
                download_wheels(Path(folder), platform)
        found = sorted(Path(folder).glob("*.whl"))
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("blender_manifest.toml", manifest([wheel.name for wheel in found], platforms))
            for file in sorted(ADDON.glob("*.py")):
                archive.write(file, file.name)
            for wheel in found:
                archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
    return path


def write_studio_look(path: Path) -> Path:
    """Write the script that dresses an imported stage as our own pictures, and return its path.

    Raises:
        InputError: it cannot be written.
    """
    check_writable(path, (".py",))
    with whole_file(path) as temporary:
        temporary.write_bytes(STUDIO_LOOK.read_bytes())
    return path


def own_platform() -> str:
    """Return Blender's name of this machine's platform."""
    return {"win32": "windows-x64", "darwin": "macos-arm64"}.get(sys.platform, "linux-x64")


def manifest(wheels: Sequence[str], platforms: Sequence[str]) -> str:
    """Return the manifest, blender_manifest.toml, of an extension with wheels of these names."""
    version = re.match(r"\d+\.\d+\.\d+", _version())
    fields = MANIFEST | {"version": version[0] if version else "0.0.0"}
    if wheels:
        fields |= {"platforms": list(platforms), "wheels": [f"./wheels/{name}" for name in wheels]}
    lines = [f"{name} = {toml_value(value)}" for name, value in fields.items()]
    permissions = [f"{name} = {toml_value(value)}" for name, value in PERMISSIONS.items()]
    return "\n".join([*lines, "", "[permissions]", *permissions, ""])


def download_wheels(folder: Path, platform: str) -> None:
    """Download the wheels that a bake needs on a platform.

    Raises:
        InputError: pip cannot; the message ends with what it says.
    """
    wanted = [line for line in metadata.requires("balloon-warp") or [] if re.split("[^a-z-]", line)[0] in NEEDED]
    plain = [line.partition(";")[0] for line in wanted if "extra ==" not in line and "3.13" not in line]
    tags = [part for tag in PLATFORMS[platform] for part in ("--platform", tag)]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:", "--dest", str(folder)]
    done = subprocess.run(
        [*command, "--python-version", PYTHON, *tags, *plain, NUMPY], capture_output=True, text=True, check=False
    )
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or done.stderr.splitlines()
        raise InputError(f"--platform {platform}: pip cannot download its wheels: {said[-1] if said else 'no reason'}")
    for numpy in folder.glob("numpy-*.whl"):
        numpy.unlink()


def write_own_wheel(folder: Path) -> Path:
    """Write a wheel of the package that runs, also from a source tree, and return its path."""
    name = f"balloon_warp-{_version()}"
    about = f"{name}.dist-info"
    path, record = folder / f"{name}-py3-none-any.whl", []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:

        def add(name: str, content: bytes) -> None:
            wheel.writestr(name, content)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            record.append(f"{name},sha256={digest},{len(content)}")

        for within, file in _own_files():
            add(within, file.read_bytes())
        add(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: balloon-warp\nVersion: {_version()}\n".encode())
        add(f"{about}/WHEEL", WHEEL)
        wheel.writestr(f"{about}/RECORD", "\n".join([*record, f"{about}/RECORD,,", ""]))
    return path


def _own_files() -> Iterator[tuple[str, Path]]:
    """Iterate over the package's files, with their places in a wheel."""
    roots: dict[str, Path] = {}
    for name in ("balloon_warp", "balloon_warp.kernels", "balloon_warp.scenes"):  # in a source tree side by side
        if (spec := find_spec(name)) and spec.submodule_search_locations:
            roots[name.replace(".", "/")] = Path(spec.submodule_search_locations[0])
    seen: set[str] = set()
    for place, root in roots.items():
        for file in sorted(root.rglob("*")):
            within = f"{place}/{file.relative_to(root).as_posix()}"
            if file.is_file() and "__pycache__" not in file.parts and within not in seen:
                seen.add(within)
                yield within, file


def _version() -> str:
    """Return the installed version.

    Raises:
        InputError: the package is not installed.
    """
    try:
        return metadata.version("balloon-warp")
    except metadata.PackageNotFoundError:
        raise InputError("balloon-warp is not installed here; expected pip install . in its folder") from None
