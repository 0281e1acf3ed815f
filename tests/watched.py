"""Watch of commands, which prints the files that they opened, their connections and the processes that they started:
JSON on the last line of standard output.

Run as a process of its own: `python watched.py FOLDER '[["inspect", "ball.obj"], ["python", "1 + 1"]]'`. Files that
Python opens anywhere an audit hook sees; those that native code opens in the folder, as USD and Warp do, the kernel
reports (inotify)."""

import ctypes
import json
import os
import struct
import sys
from pathlib import Path

IN_OPEN, IN_MOVED_TO, IN_CREATE, IN_DELETE, IN_CLOSE_WRITE = 0x20, 0x80, 0x100, 0x200, 0x8
HEADER = struct.Struct("iIII")
CALLS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.connect", "socket.bind")
CALLS += ("socket.getaddrinfo", "socket.gethostbyname", "socket.sendto", "urllib.Request", "webbrowser.open")


class Watch:
    """Watch over the files of some folders."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._events = self._libc.inotify_init1(os.O_NONBLOCK)
        self._folders: dict[int, str] = {}

    def add(self, folder: Path, name: str) -> None:
        mask = IN_OPEN | IN_MOVED_TO | IN_CREATE | IN_DELETE | IN_CLOSE_WRITE
        self._folders[self._libc.inotify_add_watch(self._events, bytes(folder), mask)] = name

    def read(self) -> list[tuple[str, str]]:
        """Return the events since, with their files: [("opened", "ball.obj"), ...]; opened folders are left out."""
        happened = []
        while True:
            try:
                events = os.read(self._events, 1 << 16)
            except BlockingIOError:
                return happened
            while events:
                folder, mask, _, length = HEADER.unpack_from(events)
                name = events[HEADER.size : HEADER.size + length].rstrip(b"\0").decode()
                events = events[HEADER.size + length :]
                if name and not mask & 0x40000000:  # no folder
                    kind = "opened" if mask & IN_OPEN else "changed"
                    happened.append((kind, os.path.join(self._folders[folder], name)))


def main() -> None:
    folder, commands = Path(sys.argv[1]), json.loads(sys.argv[2])
    os.chdir(folder)
    from balloon_warp.cli import main as balloon_warp

    opened: list[str] = []
    called: list[str] = []

    def hear(event: str, arguments: tuple) -> None:
        if event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
            opened.append(os.path.abspath(os.fsdecode(arguments[0])))
        elif event in CALLS:
            called.append(f"{event} {arguments[1:] if event.startswith('socket.') else arguments}")

    sys.addaudithook(hear)
    watch = Watch()
    for path in (folder, *folder.glob("*/")):
        watch.add(path, os.path.relpath(path, folder) if path != folder else "")
    told = []
    for words in commands:
        opened.clear()
        called.clear()
        watch.read()
        sys.argv = ["balloon-warp", *words]
        status = None
        try:
            if words[0] == "python":
                exec(words[1])
            else:
                balloon_warp()
        except SystemExit as ended:
            status = ended.code
        told.append({"status": status, "opened": list(opened), "called": list(called), "happened": watch.read()})
    import warp as wp

    told[0]["cache"] = str(wp.config.kernel_cache_dir)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
