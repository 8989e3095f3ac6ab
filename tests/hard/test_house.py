"""The house of design.md: the top level holds what it names, and libmodal has no state (arrows and
pages: tests/house).
"""
import os
import pathlib
import re
import subprocess

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build"))


def test_the_top_level_holds_only_what_the_design_names():
    allowed = {"src", "proto", "clients", "tests", "systemd", "CMakeLists.txt",
               "CMakePresets.json", "README.md", "CHANGELOG.md", "LICENSE"}
    tracked = subprocess.run(["git", "ls-tree", "--name-only", "HEAD"], cwd=TOP,
                             capture_output=True, text=True).stdout.split()
    assert {name for name in tracked if not name.startswith(".")} <= allowed


def test_libmodal_has_nothing_that_can_be_written_and_knows_no_threads():
    """A library without state can be called from anywhere: its objects have no variables, but
    constants of the linker's.
    """
    table = subprocess.run(["objdump", "-t", BUILD / "lib/libmodal.a"], capture_output=True,
                           text=True, check=True).stdout
    symbols = [line.split() for line in table.splitlines() if re.match(r"[0-9a-f]{16} ", line)]
    if any("__asan" in symbol[-1] for symbol in symbols):
        pytest.skip("the sanitizer has variables of its own in every object")
    section = re.compile(r"\.(t?data|t?bss)(?!\.rel\.ro)|\*COM\*")
    written = [s[-1] for s in symbols if any(section.match(word) for word in s[1:-1])
               and s[-1] not in s[1:-1]]
    threads = [s[-1] for s in symbols if "*UND*" in s
               and re.match(r"(pthread|thrd|mtx|sem)_", s[-1])]
    assert any(s[-1] == "modal_identify" for s in symbols), "no symbols were read"
    assert not written and not threads, (written, threads)
