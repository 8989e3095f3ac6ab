"""What the manual says of scenes comes from the tables by which they are read: nothing that they accept is missing in it."""
import re
import subprocess

import pytest
from conftest import BUILD, PATIENCE, TOP, environment

SOURCES = sorted((TOP / "src" / "modal" / "scene").rglob("*.c"))


def told(*words):
    done = subprocess.run([BUILD / "bin" / "modalctl", "help", "scene", *words], capture_output=True, text=True, timeout=PATIENCE, env=environment())
    return done.returncode, done.stdout, done.stderr


def rows():
    """Every key of every table, by its source."""
    return [(path.name, key) for path in SOURCES for key in re.findall(r'\{ "(\w+)", SCENE_[A-Z]+\b', path.read_text())]


def test_every_key_of_the_source_has_its_line_in_the_help():
    status, text, _ = told()
    found = rows()
    assert status == 0 and len(found) > 80, found
    missing = [(name, key) for name, key in found if not re.search(rf"^ +{key}(:|$)", text, re.M)]
    assert not missing, missing


@pytest.mark.parametrize("folder, list_name", [("effects", "effects"), ("structures", "structure")])
def test_every_effect_and_structure_is_told_with_its_law_alone_too(folder, list_name):
    names = [n for path in SOURCES if path.parent.name == folder for n in re.findall(r'_kind \w+ = \{\s*\.name = "(\w+)"', path.read_text())]
    assert len(names) >= 5, names
    for name in names:
        status, text, _ = told(name)
        assert status == 0 and f'{list_name} of type "{name}"' in text, (name, text)
        head, law = text.splitlines()[:2]
        assert law.startswith("  ") and law.strip(), (name, text)


def test_signs_units_ranges_and_defaults_are_told():
    text = told("gap")[1]
    assert "minus stiffness (d - clearance)(1 + dissipation d') on dof where d > clearance" in text
    assert "a number, N/m, from 0; needed" in text and "a number, s/m, from 0; default 0" in text


def test_a_type_that_is_none_is_refused_with_those_that_are():
    status, _, said = told("gaps")
    assert status == 2 and '"gaps"' in said and "gap, " in said and "friction" in said, said


def test_the_manual_page_of_scenes_has_all_that_the_help_has():
    """As it is installed, and without a line that groff would take for a request of its own."""
    page = (BUILD / "modald-scene.5").read_text()
    shown = page.split(".SH KEYS\n.nf\n")[1].split(".fi\n.SH SEE ALSO")[0]
    assert shown.replace("\\-", "-").replace("\\e", "\\").replace("\\&", "") == told()[1]
    assert not re.search(r"^[.']", shown, re.M)
