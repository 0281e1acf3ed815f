"""The command `balloon-warp doctor`."""

import json
from typing import TYPE_CHECKING

import typer

from balloon_warp.cli.options import Device, Json
from balloon_warp.cli.progress import Console
from balloon_warp.warp_logging import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.doctor import Report, SelfTest


def doctor(device: Device = None, as_json: Json = False) -> None:
    """Report the installation, the default device and missing extras, and run a self-test of one second.

    The exit status is 1 if the test fails.
    """
    quiet_warp()
    from balloon_warp.doctor import examine  # loads Warp

    report = examine(device)
    if as_json:
        print(json.dumps(report.as_json(), indent=2))
    else:
        _print(report, Console(emoji=False, highlight=False, soft_wrap=True))
    if not report.self_test.passed:
        raise typer.Exit(1)


def _print(report: "Report", console: Console) -> None:
    lines = {
        "versions": ", ".join(f"{name} {version}" for name, version in report.versions.items()),
        "system": report.system,
        "device": f"{report.device}; Warp sees {', '.join(report.devices)}",
        "kernels": f"cached in {report.kernel_cache}",
        **{f"extra {name}": _extra(name, missing) for name, missing in report.missing.items()},
        "self-test": _verdict(report.self_test),
    }
    for name, said in lines.items():
        console.print(f"{name:<14} {said}", markup=False)


def _extra(name: str, missing: list[str]) -> str:
    return f"missing {', '.join(missing)}: pip install 'balloon-warp[{name}]'" if missing else "installed"


def _verdict(test: "SelfTest") -> str:
    found = f"fell {test.fallen:.5f} m in a second (expected {test.expected:.5f} m) and grew to {test.grown:.2f} times"
    word = "passed" if test.passed else "FAILED"
    return f"{word} in {test.seconds:.1f} s: a balloon {found} its volume"
