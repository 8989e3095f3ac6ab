"""What the sanitizers say, from whichever process: no report may pass because the test that
provoked it looked elsewhere.

AddressSanitizer's report of any program goes to a file of ours, UndefinedBehaviorSanitizer's to its
stderr; that of a worker, which may write no file, to its stderr, whose end the daemon logs with the
exit status 99 that only a sanitizer gives.  conftest.py asks after each test's teardown.
"""
import os
import pathlib
import re
import shutil
import tempfile

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).resolve().parents[2]
                                    / "build"))
SANITIZED = b"__asan_init" in (BUILD / "bin" / "modalctl").read_bytes()
STATUS = 99
SPOKEN = re.compile(
    rf".*(?:ERROR: \w+Sanitizer|: runtime error: |event=worker_exit .*status={STATUS << 8}\b).*")

folder = None       # of the reports; None on a build without sanitizers
heard = []          # reports out of logs


def begin():
    """Tell all programs started from here on where to report."""
    global folder
    if not SANITIZED:
        return
    folder = pathlib.Path(tempfile.mkdtemp(prefix="modald-reports-"))
    folder.chmod(0o1777)                                     # workers may run as another user
    for program in (BUILD / "bin").iterdir():
        if program.name != "modald-worker":
            (folder / f"{program.name}.options").write_text(f"log_path={folder}/report\n")
    common = f"exitcode={STATUS}:print_legend=0:include_if_exists={folder}/%b.options"
    os.environ["ASAN_OPTIONS"] = f"detect_stack_use_after_return=0:{common}"
    os.environ["UBSAN_OPTIONS"] = f"print_stacktrace=1:{common}"


def hear(text):
    """Keep what TEXT, a daemon's log or a worker's stderr, has of reports."""
    heard.extend(SPOKEN.findall(text) if SANITIZED else [])


def reports():
    """All since the last call."""
    out = heard[:]
    heard.clear()
    for file in sorted(folder.glob("report.*")) if folder else []:
        out.append(file.read_text(errors="replace"))
        file.unlink()
    return out


def end():
    if folder:
        shutil.rmtree(folder, ignore_errors=True)
