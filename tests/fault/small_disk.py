"""A small file system for tests of full disks, which no end of a test run leaves mounted.

It is mounted and unmounted by a process of its own, in a session of its own, that waits for the end
of a pipe: however the test ends, kill -9 of its process group included, the pipe ends with it.  A
mount whose test is gone all the same (the machine's power was cut in between) is taken away when
the next test asks for one.
"""
import contextlib
import os
import pathlib
import subprocess
import tempfile

import pytest

KEEPER = ('trap "" HUP INT TERM; mount -t tmpfs -o "$1" modald-test "$2" && echo mounted; cat '
          '>/dev/null; umount -l "$2"; rmdir "$2"')


def unmount_stale():
    for line in pathlib.Path("/proc/mounts").read_text().splitlines():
        source, target = line.split()[:2]
        owner = pathlib.Path(target).name.split("-")
        if (source == "modald-test" and owner[:2] == ["modald", "disk"]
            and not os.path.exists(f"/proc/{owner[2]}")):
            subprocess.run(["umount", "-l", target], check=False)
            with contextlib.suppress(OSError):
                os.rmdir(target)


@contextlib.contextmanager
def small_disk(options):
    """The folder of a tmpfs with mount's OPTIONS; the test is skipped where this user may not
    mount.
    """
    unmount_stale()
    folder = tempfile.mkdtemp(prefix=f"modald-disk-{os.getpid()}-")
    keeper = subprocess.Popen(["sh", "-c", KEEPER, "sh", options, folder], stdin=subprocess.PIPE,
                              stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        if keeper.stdout.readline() != "mounted\n":
            pytest.skip("mounting a tmpfs is not allowed here")
        yield folder
    finally:
        keeper.communicate()
