"""Files of signals as modalctl reads them: one reader for all who read files."""
from __future__ import annotations

import os
import subprocess
import tempfile

from . import wire
from .daemon import program
from .inputs import Batch
from .link import Error


def read(path: str | os.PathLike[str], dt: float | None = None, dataset: str | None = None, *,
         ignore_time: bool = False, scale: float | None = None) -> Batch:
    """The signals of a file as a Batch: HDF5, MATLAB v5 to v7.3, NPY, NPZ, UFF 58, OpenFAST's
    .out and .outb, CSV, WAV, FLAC, told by its contents (needs the program modalctl, and h5py).

    `dt` [s] between samples where the file does not say; with `ignore_time` its rows are even,
    `dt` apart, whatever it says of time.  `dataset` names the array where there are several (the
    Error lists them), `scale` multiplies every sample.
    """
    name = os.fsdecode(path)
    if "\0" in name:
        raise Error("bad_input", f"{name!r}: no name of a file has a zero byte", "file")
    words = [program("modalctl"), "--local", "--json", "export",
             f"./{name}" if name.startswith("-") else name]          # a name, and no option
    for name, value in (("--dt", dt), ("--dataset", dataset), ("--scale", scale)):
        words += [] if value is None else [name, str(value)]
    words += ["--ignore-time"] if ignore_time else []
    with tempfile.TemporaryDirectory(prefix="modald-") as folder:
        out = os.path.join(folder, "signals.h5")
        done = subprocess.run([*words, "-O", out], capture_output=True, check=False)
        try:
            said = wire.loads(done.stdout)
        except ValueError as why:
            raise Error("internal", f"{words[0]} ended with {done.returncode}: "
                        f"{done.stderr[-300:].decode(errors='replace')}") from why
        if "error" in said:
            raise Error.of(said["error"])
        return Batch.read(out)
