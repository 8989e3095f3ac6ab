"""The tutorials of section 7 are sessions of a shell: each is typed as it stands, and prints what
the page says."""
import contextlib
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import threading

import pytest
import sanitized
from conftest import BUILD, PATIENCE, TOP, environment

PAGES = sorted((TOP / "clients" / "ctl").glob("*.7"))
# what is below is rounding, of other digits on other processors
ROUNDING = 1e-9


def lines(page):
    """As they are shown, of each stretch that is set as it stands."""
    for block in re.findall(r"^\.nf\n(.*?)^\.fi$", page.read_text(), re.M | re.S):
        for line in block.splitlines():
            yield line.replace("\\&", "").replace("\\-", "-").replace("\\e", "\\")


def session(page):
    """[command, what it prints]; a here-document belongs to its command."""
    steps, inside = [], False
    for line in lines(page):
        if line.startswith("# ") and not inside:                   # root's, who is not here
            continue
        if inside or (line.startswith("$ ") and not inside):
            if inside:
                steps[-1][0] += "\n" + line
                inside = line != "END"
            else:
                steps.append([line[2:], []])
                inside = line.endswith("<<'END'")
        else:
            steps[-1][1].append(line)
    return steps


def same(shown, printed):
    """Word for word; numbers to the digits that a page needs; "..." at its end leaves out."""
    a, b = (re.split(r"[\s,]+", text.strip()) for text in (shown, printed))
    if a[-1] == "...":
        a, b = a[:-1], b[:len(a) - 1]
    if len(a) != len(b):
        return False
    for x, y in zip(a, b):
        try:
            if not math.isclose(float(x), float(y), rel_tol=1e-4, abs_tol=ROUNDING):
                return False
        except ValueError:
            if x != y:
                return False
    return True


class Shell:
    """One for a whole session, so that what it exports and starts stays; it ends with all of it."""

    MARK = "the command has ended"

    def __init__(self, folder, env):
        self.said = open(folder / ".stderr", "w+")
        self.process = subprocess.Popen(["bash"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=self.said,
                                        text=True, cwd=folder, env=env, start_new_session=True)

    def run(self, command):
        """Exit status, lines of stdout, stderr."""
        self.said.seek(0)
        self.said.truncate()
        late = threading.Timer(PATIENCE, self.end)
        late.start()
        try:
            self.process.stdin.write(f"{command}\nprintf '\\n%s %d\\n' '{self.MARK}' $?\n")
            self.process.stdin.flush()
            out = []
            for line in self.process.stdout:
                if line.startswith(self.MARK):
                    break
                out.append(line.rstrip("\n"))
            else:
                line = "- 1"
        finally:
            late.cancel()
        self.said.seek(0)
        return int(line.split()[-1]), out[:-1], self.said.read()

    def end(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)

    def close(self):
        self.end()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()
        self.said.close()


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("install") / "usr"
    subprocess.run(["cmake", "--install", str(BUILD), "--prefix", str(prefix)], check=True,
                   capture_output=True)
    return next(path.parent for path in prefix.glob("lib/**/libmodal.a"))


@pytest.fixture
def surroundings(page, request, tmp_path_factory):
    """The environment that PAGE is typed in: our programs, and where it compiles, our libraries."""
    tools = tmp_path_factory.mktemp("bin")
    (tools / "python3").symlink_to(sys.executable)
    env = environment(PATH=f"{tools}:{BUILD / 'bin'}:{os.environ['PATH']}",
                      PYTHONPATH=TOP / "clients" / "python")
    if "pkg-config" in "\n".join(lines(page)):
        if sanitized.SANITIZED:
            pytest.skip("what links our libraries would need the sanitizers' own runtime")
        for tool in ("cc", "gfortran", "pkg-config"):
            if shutil.which(tool) is None:
                pytest.skip(f"no {tool}")
        lib = request.getfixturevalue("installed")
        env |= {"PKG_CONFIG_PATH": str(lib / "pkgconfig"), "LD_LIBRARY_PATH": str(lib)}
    return env


def compare(command, shown, printed):
    """What is SHOWN and what is PRINTED, line by line; "..." leaves out."""
    rest, skip = list(printed), False
    for line in shown:
        if line == "...":
            skip = True
            continue
        while skip and rest and not same(line, rest[0]):
            rest.pop(0)
        said = "\n".join(printed)
        assert rest and same(line, rest[0]), f"{command}\nshows\n{line}\nprints\n{said}"
        rest.pop(0)
        skip = False
    assert skip or not rest, f"{command}\nprints more\n" + "\n".join(rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_a_tutorial_prints_what_its_page_says(page, tmp_path, surroundings):
    steps = session(page)
    assert len(steps) >= 8
    with contextlib.closing(Shell(tmp_path, surroundings)) as shell:
        for command, shown in steps:
            status, printed, errors = shell.run(command)
            assert status == 0, (command, printed, errors)
            compare(command, shown, printed)


def test_the_pages_are_there_and_lead_to_files_that_they_make():
    assert {p.name for p in PAGES} >= {f"modald-{name}.7"
                                       for name in ("identify", "steady", "live", "lab")}
