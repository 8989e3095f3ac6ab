"""The tutorials of section 7 are sessions of a shell: each is typed as it stands, and prints what the page says."""
import math
import os
import re
import subprocess

import pytest
from conftest import BUILD, PATIENCE, TOP, environment

PAGES = sorted((TOP / "clients" / "ctl").glob("*.7"))
ROUNDING = 1e-9                          # what is below is rounding, of other digits on other processors


def lines(page):
    """As they are shown, of each stretch that is set as it stands."""
    for block in re.findall(r"^\.nf\n(.*?)^\.fi$", page.read_text(), re.M | re.S):
        for line in block.splitlines():
            yield line.replace("\\&", "").replace("\\-", "-").replace("\\e", "\\")


def session(page):
    """[command, what it prints]; a here-document belongs to its command."""
    steps, inside = [], False
    for line in lines(page):
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
    """Word for word; numbers to the digits that a page needs."""
    a, b = shown.split(), printed.split()
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


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_a_tutorial_prints_what_its_page_says(page, tmp_path):
    steps = session(page)
    assert len(steps) >= 8
    for command, shown in steps:
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=PATIENCE, cwd=tmp_path,
                              env=environment(PATH=f"{BUILD / 'bin'}:{os.environ['PATH']}"))
        assert done.returncode == 0, (command, done.stderr)
        rest, skip = done.stdout.splitlines(), False
        for line in shown:
            if line == "...":
                skip = True
                continue
            while skip and rest and not same(line, rest[0]):
                rest.pop(0)
            assert rest and same(line, rest[0]), f"{command}\nshows\n{line}\nprints\n{done.stdout}"
            rest.pop(0)
            skip = False
        assert skip or not rest, f"{command}\nprints more\n" + "\n".join(rest)


def test_the_pages_are_there_and_lead_to_files_that_they_make():
    assert {p.name for p in PAGES} >= {"modald-identify.7", "modald-steady.7"}
