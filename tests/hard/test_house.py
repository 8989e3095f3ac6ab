"""The house of design.md: arrows between the folders of src point down only, and the top level holds what it names."""
import os
import pathlib
import re
import subprocess

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build"))

# What each folder may include, besides itself, the ground (base) and the files directly under src/modal.
BELOW = {
    "base": set(),
    "modal": set(),
    "modal/linalg": set(),
    "modal/identify": {"modal/linalg"},
    "modal/scene": {"modal/linalg"},
    "modal/steady": {"modal/linalg", "modal/scene"},
    "job": {"modal/linalg", "modal/identify", "modal/scene", "modal/steady"},
    "store": set(),
    "wire": set(),
    "worker": {"job", "store", "wire"},
    "broker": {"job", "store", "wire"},
}
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)


def folder_of(path):
    """The room a path under src belongs to: the longest known prefix."""
    parts = path.split("/")[:-1]
    while parts and "/".join(parts) not in BELOW:
        parts.pop()
    return "/".join(parts)


def arrows():
    src = TOP / "src"
    for file in sorted(src.rglob("*.[ch]")):
        room = folder_of(str(file.relative_to(src)))
        for name in INCLUDE.findall(file.read_text()):
            target = name if (src / name).exists() else str((file.parent / name).resolve().relative_to(src))
            yield str(file.relative_to(src)), room, target, folder_of(target)


def test_arrows_between_folders_point_down_only():
    wrong = [f"{file} includes {target}" for file, room, target, to in arrows()
             if to != room and to not in BELOW[room] | ({"base"} if room != "base" else set()) | ({"modal"} if room not in ("base", "modal") else set())]
    assert not wrong, "\n".join(wrong)


def test_no_two_files_include_each_other_in_a_cycle():
    graph = {}
    for file, _, target, _ in arrows():
        graph.setdefault(file, set()).add(target)
    done, path = set(), []

    def visit(file):
        assert file not in path, " -> ".join(path + [file])
        if file in done:
            return
        path.append(file)
        for target in sorted(graph.get(file, ())):
            visit(target)
        path.pop()
        done.add(file)
    for file in sorted(graph):
        visit(file)


def test_the_top_level_holds_only_what_the_design_names():
    allowed = {"src", "proto", "clients", "tests", "systemd", "CMakeLists.txt", "CMakePresets.json", "README.md", "LICENSE"}
    tracked = subprocess.run(["git", "ls-tree", "--name-only", "HEAD"], cwd=TOP, capture_output=True, text=True).stdout.split()
    assert {name for name in tracked if not name.startswith(".")} <= allowed


def test_libmodal_has_nothing_that_can_be_written_and_knows_no_threads():
    """A library without state can be called from anywhere: its objects have no variables, but constants of the linker's."""
    table = subprocess.run(["objdump", "-t", BUILD / "lib/libmodal.a"], capture_output=True, text=True, check=True).stdout
    symbols = [line.split() for line in table.splitlines() if re.match(r"[0-9a-f]{16} ", line)]
    if any("__asan" in symbol[-1] for symbol in symbols):
        pytest.skip("the sanitizer has variables of its own in every object")
    section = re.compile(r"\.(t?data|t?bss)(?!\.rel\.ro)|\*COM\*")
    written = [s[-1] for s in symbols if any(section.match(word) for word in s[1:-1]) and s[-1] not in s[1:-1]]
    threads = [s[-1] for s in symbols if "*UND*" in s and re.match(r"(pthread|thrd|mtx|sem)_", s[-1])]
    assert any(s[-1] == "modal_identify" for s in symbols), "no symbols were read"
    assert not written and not threads, (written, threads)
