"""Processes of the system: the page among strangers, streams that are closed, forks, two writers, and scaling."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import warp as wp
from meshes import cube, quad_sphere
from strangers import PROTOCOL, joined, served
from websockets.exceptions import InvalidStatus

from balloon_warp import Balloon, InputError, Scene, Simulator, show
from balloon_warp.benchmarks import scaling
from balloon_warp.benchmarks.cases import Case
from balloon_warp.benchmarks.scaling import CPU_SHARE, GPU_SHARE, Share, measure_scaling
from balloon_warp.errors import WorkersLostError
from balloon_warp.mesh.obj import write_obj
from balloon_warp.studio.page.page import Page
from balloon_warp.studio.page.server import MOST_TOLD, Origins, free_port, guarded, is_ours, names_of
from balloon_warp.studio.page.session import Session


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Iterator[Page]:
    with served(tmp_path_factory.mktemp("recordings")) as page:
        yield page


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1.evil.example", "null", "http://127.0.0.1:1", "//", "http://["]
)
def test_another_site_may_not_talk_to_the_page(page: Page, origin: str):
    with pytest.raises(InvalidStatus) as refused, joined(page, Origin=origin):
        pass
    assert refused.value.response.status_code in (403, 500)


def test_the_page_may_talk_to_itself(page: Page):
    for name in ("127.0.0.1", "localhost"):
        authority = f"{name}:{page.server.get_port()}"
        assert talks(page, authority, f"http://{authority}").startswith("HTTP/1.1 101")


@pytest.mark.parametrize("path", ["/", "/socket"])
def test_a_name_that_points_here_is_not_this_machine(page: Page, path: str):
    """DNS rebinding is refused: evil.example lets its own name point to 127.0.0.1, so that Origin and Host agree."""
    authority = f"evil.example:{page.server.get_port()}"
    assert talks(page, authority, f"http://{authority}").startswith("HTTP/1.1 403")
    assert ask(page, "/", f"Host: {authority}").startswith("HTTP/1.1 403")
    assert ask(page, "/", "Host: localhost", f"Host: {authority}").startswith("HTTP/1.1 403")
    assert ask(page, "/").startswith("HTTP/1.1 403")


def test_addresses_and_own_names_are_this_machine():
    names = names_of("balloons.example")
    for ours in ("127.0.0.1:8080", "[::1]:8080", "192.0.2.7", "localhost:1", "balloons.example", socket.gethostname()):
        assert is_ours(ours, names), ours
    for other in ("evil.example", "", ":8080", "127.0.0.1.evil.example", "[::1", "127.0.0.1@evil.example", "a b"):
        assert not is_ours(other, names), other


def ask(page: Page, path: str, *headers: str) -> str:
    """Return the answer to a raw socket."""
    with socket.create_connection(("127.0.0.1", page.server.get_port()), timeout=60) as raw:
        raw.sendall("\r\n".join([f"GET {path} HTTP/1.1", *headers, "", ""]).encode("latin-1"))
        parts = []
        with contextlib.suppress(TimeoutError, ConnectionResetError):
            while part := raw.recv(1 << 16):
                parts.append(part)
                if b" 101 " in part:
                    break
        return b"".join(parts).decode("latin-1")


def talks(page: Page, host: str, origin: str) -> str:
    """Return the answer where a web socket is to open."""
    upgrade = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==")
    version = ("Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: {PROTOCOL}")
    return ask(page, "/", f"Host: {host}", f"Origin: {origin}", *upgrade, *version)


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../../../../../etc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2f..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
        "/..\\..\\..\\..\\..\\..\\..\\etc\\passwd",
        "/%5c..%5c..%5c..%5cetc%5cpasswd",
        "/%252e%252e/%252e%252e/etc/passwd",
        "//etc/passwd",
        "/%2fetc%2fpasswd",
        "/file:///etc/passwd",
        "/assets/../../../_viser.py",
        "/proc/self/environ",
        "/index.html%00.txt",
        "/assets",
        "/" + "a" * 5000,
        "/\xff",
    ],
)
def test_the_page_serves_no_file_but_its_own(page: Page, path: str):
    answer = ask(page, path, "Host: localhost")
    assert not answer.startswith("HTTP/1.1 200")
    assert "root:" not in answer
    assert "import" not in answer
    assert ask(page, "/index.html", "Host: localhost").startswith("HTTP/1.1 200")  # by the same way


def test_what_is_served_has_no_link_out_and_a_page_is_guarded_or_not_there(page: Page):
    root = page.server._websock_server._http_server_root
    assert root is not None
    assert not [path for path in Path(root).rglob("*") if path.is_symlink()]
    with pytest.raises(RuntimeError, match="not guarded"), guarded("127.0.0.1", lambda _: None, Origins([], print)):
        pass


@pytest.mark.parametrize(
    ("host", "heard_at"), [(None, "127.0.0.1"), ("localhost", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")]
)
def test_a_page_for_others_warns_and_no_stranger_fills_the_terminal(host: str | None, heard_at: str, tmp_path):
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    port = free_port("127.0.0.1", 0)
    command = [sys.executable, "-m", "balloon_warp", "view", "ball.obj", "--device", "cpu", "--port", str(port)]
    command, pipe = [*command, *(["--host", host] if host else [])], subprocess.PIPE
    process = subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True)
    assert process.stdout
    try:
        printed = [process.stdout.readline()]
        assert printed[0].startswith("ball is at http://")
        printed += [process.stdout.readline()] if host == "0.0.0.0" else []
        listening = [each.laddr for each in psutil.Process(process.pid).net_connections() if each.status == "LISTEN"]
        assert [address.port for address in listening] == [port] * len(listening)
        assert {address.ip for address in listening} - {"::1"} == {heard_at}
        for opening in (b"\x16\x03\x01 garbage\r\n\r\n", b"GET /\xff HTTP/1.1\r\nHost: evil.example\r\n\r\n", b""):
            with socket.create_connection(("127.0.0.1", port), timeout=60) as stranger:
                stranger.sendall(opening)
                stranger.shutdown(socket.SHUT_WR)
                with contextlib.suppress(ConnectionResetError):
                    while stranger.recv(1 << 16):
                        pass
    finally:
        process.send_signal(signal.SIGINT)
        rest, complaints = process.communicate(timeout=300)
    assert process.returncode == 0
    assert complaints.startswith("note: ball.obj inflates above a floor. ")
    told = complaints.splitlines()[1:]  # of the browser that may be behind a proxy, once, and of nothing else
    assert len(told) <= 1
    assert all("a page at https://evil.example is refused" in line for line in told)
    warning = (
        f"warning: anyone who reaches port {port} of this machine can watch and control the page, and save recordings "
        f"into {tmp_path.resolve()}; it has no encryption and no login\n"
    )
    assert printed[1:] == ([warning] if host == "0.0.0.0" else [])
    assert rest == "the page is closed\n"


PROXY, OTHER = "https://me-8471.app.example", "https://other.example"


@pytest.fixture(scope="module")
def told() -> list[str]:
    return []


@pytest.fixture(scope="module")
def proxied(told: list[str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(2))])
    session = Session("ball", scene, "cpu", tmp_path_factory.mktemp("recordings"))
    page = Page(session, port=None, origins=[f"{PROXY}/"], on_refused=told.append)
    page.start()
    yield page
    page.stop()


def test_a_proxy_that_is_named_may_hand_the_page_on(proxied: Page):
    """A named proxy may forward the page, whether it replaces the host by this machine's or passes the original on."""
    here = f"localhost:{proxied.server.get_port()}"
    assert talks(proxied, here, PROXY).startswith("HTTP/1.1 101")
    assert talks(proxied, "me-8471.app.example", PROXY).startswith("HTTP/1.1 101")
    shown = ask(proxied, "/", f"Host: {here}", "Connection: close")
    assert f"vscode-webview: {PROXY}" in shown  # a notebook at the proxy may have it in a cell


def test_another_is_refused_and_the_terminal_and_the_page_say_how_it_would_not_be(proxied: Page, told: list[str]):
    here = f"localhost:{proxied.server.get_port()}"
    told.clear()
    for _ in range(2):
        assert talks(proxied, here, OTHER).startswith("HTTP/1.1 403")
    assert len(told) == 1
    assert f"--origin {OTHER}" in told[0]
    answer = ask(proxied, f"/may-i?from={OTHER.replace(':', '%3A').replace('/', '%2F')}", f"Host: {here}")
    assert answer.startswith("HTTP/1.1 403")
    assert answer.endswith(told[0])
    for origin in (PROXY, f"http://{here}"):
        assert ask(proxied, f"/may-i?from={origin}", f"Host: {here}").startswith("HTTP/1.1 200")
    assert talks(proxied, "other.example", OTHER).startswith("HTTP/1.1 403")
    assert talks(proxied, here, f"{PROXY}.evil.example").startswith("HTTP/1.1 403")


def test_strangers_do_not_fill_the_terminal():
    told: list[str] = []
    origins = Origins([], told.append)
    for number in range(3 * MOST_TOLD):
        assert not origins.admit(f"https://{number}.example", "localhost:8080")
    assert not origins.admit("https://\x1b[2J.example", "localhost:8080")
    assert len(told) == MOST_TOLD


@pytest.mark.parametrize(
    "origin",
    ["hub.example", "https://", "ftp://hub.example", "https://hub.example/user/me", "https://a@b", "*", "null"],
)
def test_what_is_no_origin_is_refused(origin: str, tmp_path: Path):
    with pytest.raises(InputError, match=r"^origin .*: expected http:// or https://, a host"):
        show(Simulator(Scene(balloon=[Balloon(mesh=quad_sphere(2))]), "cpu"), folder=tmp_path, origins=[origin])


SECONDS = 240
"""Time after which a child counts as hanging"""
BEFORE = """
    import multiprocessing, os, sys
    import balloon_warp as bw
    from meshes import quad_sphere
    from balloon_warp.scene import Balloon, Scene

    def pressed(pressure, frames=2):
        inflation = {"kind": "pressure", "pressure": pressure}
        return Scene(balloon=[Balloon(mesh=quad_sphere(2), inflation=inflation)], frames=frames)

    def height(pressure):
        simulator = bw.Simulator(pressed(pressure), device="cpu")
        *_, last = simulator.run()
        return float(last.points[0][:, 1].max())
"""
CHILDREN = {
    "a pool, while a kernel compiles": """
        os.environ["WARP_CACHE_PATH"] = sys.argv[1]  # which has no kernels: Warp is not there yet
        bw.Simulator(pressed(1.0), device="cpu")
        with multiprocessing.get_context("fork").Pool(2) as pool:
            heights = pool.map(height, [1.0, 2.0])
        assert heights == [height(1.0), height(2.0)]
    """,
    "a simulator of its parent": """
        simulator = bw.Simulator(pressed(1.0), device="cpu", world_count=32)
        simulator.step()
        child = os.fork()
        if not child:
            simulator.step()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    """,
    "a batch after a batch": """
        values = {"balloon.mass": [1.0, 2.0]}
        bw.run_batch(pressed(1.0), sys.argv[1] + "/parent", 2, values, device="cpu")
        child = os.fork()
        if not child:
            bw.run_batch(pressed(1.0), sys.argv[1] + "/child", 2, values, device="cpu")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    """,
    "environments": """
        import gymnasium, balloon_warp.learn
        name = "BalloonWarp/Altitude-v0"
        environments = gymnasium.vector.AsyncVectorEnv([lambda: gymnasium.make(name)] * 2, context="fork")
        environments.reset(seed=1)
        environments.step(environments.action_space.sample())
        environments.close()
    """,
}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
@pytest.mark.parametrize("children", CHILDREN)
def test_forked_children_simulate(children: str, tmp_path: Path):
    program = textwrap.dedent(BEFORE) + textwrap.dedent(CHILDREN[children])
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", program, str(tmp_path)]
    subprocess.run(command, check=True, timeout=SECONDS, env={**os.environ, "PYTHONPATH": path})


SMALL = Share("cpu", Case("8 balloons", "lanes", 8, cells=3), frames=5)


def test_two_processes_simulate_a_share_each(monkeypatch: pytest.MonkeyPatch):
    began = time.perf_counter()
    (result,) = measure_scaling(SMALL, [2])
    work = 2 * 8 * 56 * 32 * SMALL.frames
    assert (result.case, result.worlds, result.particles) == ("8 balloons x 2", 16, 56)
    assert result.ratio == pytest.approx(1.0)  # the others are compared with the first count
    assert 0.0 < work / result.rate < time.perf_counter() - began


def test_the_ratio_is_the_efficiency(monkeypatch: pytest.MonkeyPatch):
    rates = {1: 100.0, 2: 190.0, 4: 300.0}
    monkeypatch.setattr(scaling, "_rate_together", lambda share, environments: (rates[len(environments)], 56))
    results = list(measure_scaling(SMALL, [1, 2, 4]))
    assert [result.ratio for result in results] == [1.0, 0.95, 0.75]
    assert [result.worlds for result in results] == [8, 16, 32]


def test_the_time_is_from_the_first_start_to_the_last_end():
    told = [(56, [(0.0, 1.0), (5.0, 6.5)]), (56, [(0.2, 1.5), (4.5, 6.0)])]
    assert scaling.spans_together(told) == [1.5, 2.0]


def test_a_process_that_fails_ends_the_others_too(capfd: pytest.CaptureFixture[str]):
    unstable = Share("cpu", Case("", "lanes", 8, cells=3, substeps=1), frames=1)
    with pytest.raises(WorkersLostError, match="a process of the benchmark failed"):
        list(measure_scaling(unstable, [2]))
    assert "substeps: 1 are too few" in capfd.readouterr().err


def test_each_process_sees_a_gpu_of_its_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 2)
    seen = []
    monkeypatch.setattr(scaling, "_rate_together", lambda _, environments: (float(seen.append(environments) or 1), 1))
    list(measure_scaling(GPU_SHARE, [1, 2]))
    assert seen == [[{"CUDA_VISIBLE_DEVICES": "0"}], [{"CUDA_VISIBLE_DEVICES": "0"}, {"CUDA_VISIBLE_DEVICES": "1"}]]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,5")
    list(measure_scaling(GPU_SHARE, [2]))
    assert seen[-1] == [{"CUDA_VISIBLE_DEVICES": "3"}, {"CUDA_VISIBLE_DEVICES": "5"}]
    with pytest.raises(InputError, match=r"^gpus 4: this machine has 2$"):
        list(measure_scaling(GPU_SHARE, [1, 4]))


@pytest.mark.parametrize("counts", [[], [0], [2, -1]])
def test_counts_below_one_are_refused(counts: list[int]):
    with pytest.raises(InputError, match=r"^--workers: expected numbers of at least 1"):
        list(measure_scaling(CPU_SHARE, counts))


RUN, BATCH = "run box.obj --frames 1 --device cpu -o", "batch box.obj --worlds 2 --frames 1 --device cpu -o"
FULL = "error: standard output: cannot be written: No space left on device"


def shell(folder: Path, words: str) -> subprocess.CompletedProcess[str]:
    """Run a command with redirections, as a shell takes them."""
    write_obj(folder / "box.obj", cube())
    line = f"'{sys.executable}' -m balloon_warp {words}"
    return subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize(
    ("words", "written"),
    [
        pytest.param(f"{RUN} out.usdc 2>&-", "out.usdc", id="no standard error"),
        pytest.param(f"{RUN} out.usdc <&- >&- 2>&-", "out.usdc", id="no stream at all"),
        pytest.param(f"{RUN} out.usdc 2> /dev/full", "out.usdc", id="standard error is full"),
        pytest.param(f"{RUN} out.usdc 2> >(true)", "out.usdc", id="nobody reads standard error"),
        pytest.param(f"{BATCH} out 2>&-", "out/manifest.json", id="a batch without standard error"),
    ],
)
def test_a_file_is_written_without_standard_error(words: str, written: str, tmp_path: Path) -> None:
    done = shell(tmp_path, words)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / written).stat().st_size > 100


@pytest.mark.parametrize("unbuffered", ["", "1"], ids=["buffered", "unbuffered"])
@pytest.mark.parametrize(
    "words", [f"{RUN} out.usdc --json", "inspect box.obj", "scenes squirrel_tether", "--version", "run --help"]
)
def test_standard_output_that_is_full_is_told(words: str, unbuffered: str, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    done = shell(tmp_path, f"{words} > /dev/full")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == FULL
    assert "Traceback" not in done.stderr


def test_a_reader_that_has_enough_is_no_mistake(tmp_path: Path) -> None:
    done = shell(tmp_path, "scenes squirrel_tether | head -n 1")
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)


LONG = "run ball.obj --frames 100000 --device cpu --checkpoint 0.2 -o out.usdc"
LONG_BATCH = "batch ball.obj --frames 100000 --device cpu --worlds 2 -o out"


def start(folder: Path, words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "balloon_warp", *words.split()]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=folder, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize(("long", "held"), [(LONG, "."), (LONG_BATCH, "out")], ids=["a run", "a batch"])
def test_the_second_is_refused_by_name_of_the_first(long: str, held: str, tmp_path: Path) -> None:
    write_obj(tmp_path / "ball.obj", quad_sphere(4))
    output, short = long.split()[-1], long.replace("100000", "1")
    first = start(tmp_path, long)
    try:
        for _ in range(1000):
            if len([*(tmp_path / held).glob(".balloon-warp-*.lock")]) > 1:  # its own, and those of files that it began
                break
            time.sleep(0.1)
        second = start(tmp_path, short)
        error = second.communicate(timeout=300)[1].splitlines()[-1]
        assert second.returncode == 2
        assert error.startswith(f"error: {output}: process {first.pid} on ")
        assert long[:40] in error
        assert first.poll() is None
    finally:
        first.kill()
        first.communicate()
    again = start(tmp_path, short)
    assert again.communicate(timeout=300) is not None
    assert again.returncode == 0
    assert not [*tmp_path.rglob(".balloon-warp-*")]
