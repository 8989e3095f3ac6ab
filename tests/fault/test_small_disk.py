"""A test that is killed leaves no mount behind."""
import os
import pathlib
import signal
import subprocess
import sys
import time

from small_disk import small_disk, unmount_stale

HOLDS = ("import sys, time; sys.path.insert(0, sys.argv[1])\nfrom small_disk import small_disk\n"
         "with small_disk('size=64k') as d: print(d, flush=True); time.sleep(600)")


def mounted(folder):
    return folder in pathlib.Path("/proc/mounts").read_text().split()


def test_a_disk_is_there_and_gone_with_its_test():
    with small_disk("size=64k") as folder:
        assert (mounted(folder) and os.statvfs(folder).f_blocks
                * os.statvfs(folder).f_frsize == 65536)
    assert not mounted(folder) and not os.path.exists(folder)


def test_a_killed_test_leaves_no_mount():
    with small_disk("size=64k"):
        pass                                            # skips where nobody may mount
    process = subprocess.Popen([sys.executable, "-c", HOLDS, str(pathlib.Path(__file__).parent)],
                               stdout=subprocess.PIPE, text=True, start_new_session=True)
    folder = process.stdout.readline().strip()
    assert mounted(folder)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    end = time.monotonic() + 600
    while os.path.exists(folder):
        assert time.monotonic() < end, f"{folder} is still there"
        time.sleep(0.01)


def test_a_mount_whose_test_is_gone_is_taken_away(tmp_path):
    with small_disk("size=64k"):
        pass
    gone = subprocess.Popen(["true"])
    gone.wait()
    stale = tmp_path / f"modald-disk-{gone.pid}-x"
    stale.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "modald-test", stale], check=True)
    unmount_stale()
    assert not mounted(str(stale)) and not stale.exists()
