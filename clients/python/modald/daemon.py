"""A daemon of one's own, in a folder that is gone with it, and where modald's programs are."""
from __future__ import annotations

import os
import pathlib
import subprocess
import tempfile
import time
import weakref
from typing import IO

from .client import Client
from .link import Error

START_S = 30.0              # s that a daemon has to answer in an empty folder

# The daemon ends, and its folder goes, when nobody holds the other end of stdin any more: this
# process closed it, or is gone.  $1: the folder; then the command.
KEEPER = """
folder=$1; shift
exec 3<&0
"$@" 3<&- </dev/null & daemon=$!
{ cat <&3; kill -TERM $daemon; } >/dev/null 2>&1 & keeper=$!
exec 3<&-
wait $daemon; status=$?
kill $keeper 2>/dev/null
rm -rf "$folder"
exit $status
"""


def program(name: str) -> str:
    """The path of modald or modalctl: $MODALD_BUILD's, a checkout's build, the one installed with
    this module, or $PATH's."""
    here, build = pathlib.Path(__file__).resolve(), os.environ.get("MODALD_BUILD")
    places = [pathlib.Path(build) / "bin"] if build else []
    places += [here.parents[3] / "build" / "bin", here.parents[4] / "bin",
               here.parents[4] / "sbin"]
    places += [pathlib.Path(p) for p in os.environ.get("PATH", os.defpath).split(os.pathsep)]
    places += [pathlib.Path("/usr/local/sbin"), pathlib.Path("/usr/sbin")]
    found = next((p / name for p in places if os.access(p / name, os.X_OK)
                  and (p / name).is_file()), None)
    if found is None:
        raise Error("bad_input", f"no program {name} beside this module, in $MODALD_BUILD or in "
                    f"$PATH (Debian package {name})", "program")
    return str(found)


def _stop(process: "subprocess.Popen[bytes]", pid: int) -> None:
    """Once, and not by a child of a fork, which has a copy of the pipe."""
    if os.getpid() == pid and process.stdin is not None and not process.stdin.closed:
        process.stdin.close()
        process.wait()


class LocalClient(Client):
    """A client whose daemon is its own: it ends with it."""

    def __init__(self, workers: int = 2, timeout: float | None = 60.0):
        """A daemon with so many workers; `timeout` [s] as of `Client`."""
        path = program("modald")
        self.folder = tempfile.mkdtemp(prefix="modald-")
        endpoint = f"ipc://{self.folder}/modald.ipc"
        with open(f"{self.folder}/log", "w+b") as log:
            process = subprocess.Popen(
                ["/bin/sh", "-c", KEEPER, "modald", self.folder, path, "--data",
                 f"{self.folder}/data", "--bind", endpoint, "--workers", str(workers)],
                stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log,
                start_new_session=True)
            self._own = weakref.finalize(self, _stop, process, os.getpid())
            self._begin(endpoint, timeout, process, log)

    def _begin(self, endpoint: str, timeout: float | None, process: "subprocess.Popen[bytes]",
               log: IO[bytes]) -> None:
        """Until the daemon answers; or its own words, from LOG, why it does not."""
        deadline = time.monotonic() + START_S
        while True:
            super().__init__(endpoint, None, timeout)
            try:
                self.hello()
                return
            except Error as why:
                super().close()
                if process.poll() is not None or time.monotonic() > deadline:
                    self._own()
                    log.seek(0)
                    said = log.read()[-300:].decode(errors="replace").strip()
                    raise Error("no_server", f"{program('modald')} did not start: {said}") from why

    def close(self) -> None:
        """End the connection and the daemon; what it held is gone."""
        super().close()
        self._own()


def local(workers: int = 2, timeout: float | None = 60.0) -> Client:
    """A client of a private daemon with `workers` workers, in a temporary folder; both end with
    `close`, with the client, or with this process.  `timeout` [s] as of `Client`.
    """
    return LocalClient(workers, timeout)
