"""What the manual says of scenes and results comes from tables: nothing that is accepted or written
is missing in it."""
# Tests as well: result_key.c mode_key.c live_key.c result_code.c
import json
import re
import subprocess

import jsonschema
import numpy as np
import pytest
from conftest import BUILD, PATIENCE, TOP, environment
from wire import Client, crc32c

CTL = BUILD / "bin" / "modalctl"
SOURCES = sorted((TOP / "src" / "modal" / "scene").rglob("*.c"))


def told(*words):
    done = subprocess.run([BUILD / "bin" / "modalctl", "help", "scene", *words],
                          capture_output=True, text=True, timeout=PATIENCE, env=environment())
    return done.returncode, done.stdout, done.stderr


def rows():
    """Every key of every table, by its source."""
    return [(path.name, key) for path in SOURCES
            for key in re.findall(r'\{ "(\w+)", SCENE_[A-Z]+\b', path.read_text())]


def test_every_key_of_the_source_has_its_line_in_the_help():
    status, text, _ = told()
    found = rows()
    assert status == 0 and len(found) > 80, found
    missing = [(name, key) for name, key in found if not re.search(rf"^ +{key}(:|$)", text, re.M)]
    assert not missing, missing


@pytest.mark.parametrize("folder, list_name", [("effects", "effects"), ("structures", "structure")])
def test_every_effect_and_structure_is_told_with_its_law_alone_too(folder, list_name):
    names = [n for path in SOURCES if path.parent.name == folder
             for n in re.findall(r'_kind \w+ = \{\s*\.name = "(\w+)"', path.read_text())]
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


# ---- metrics ----

def test_the_manual_of_the_daemon_has_each_metric_as_the_daemon_tells_it(daemon):
    """Its name, its kind and what it counts; and no other."""
    c = Client(daemon.endpoint)
    text = c.ask("METRICS").body[0].decode()
    c.close()
    given = {(name, kind, what.lower()) for name, what, kind in
             re.findall(r"# HELP (modald_\w+) (.*)\n# TYPE \S+ (\w+)", text)}
    page = (TOP / "systemd" / "modald.8").read_text().split(".SH METRICS")[1].split(".SH ")[0]
    told = {(name, kind, what.lower()) for name, kind, what in
            re.findall(r"\.TP\n\.I (modald_\w+)\n\((\w+)\) (.*)\n", page)}
    assert len(given) > 30 and told == given


# ---- results ----

def told_of(topic, *words):
    done = subprocess.run([CTL, "help", topic, *words], capture_output=True, text=True,
                          timeout=PATIENCE, env=environment())
    return done.returncode, done.stdout, done.stderr


# what they write is no result: PROTOCOL.md and scenes have theirs
ELSEWHERE = {"live.c", "tracks_text.c", "scene_mesh.c"}
JOBS = [p for p in sorted((TOP / "src" / "job").glob("*.c")) if p.name not in ELSEWHERE
        | {"result_key.c", "mode_key.c", "live_key.c", "result_code.c"}]
WRITTEN = re.compile(r'(?:cJSON_Add\w+ToObject|json_set_number)\(\s*[^;"]*?"([\w.]+)"')
OPTIONS = re.compile(r'\{ "([\w.]+)", KEY_')


def members():
    """Every member that a source writes; what is an option of a job is told by `--help`."""
    options = {o for p in JOBS for o in OPTIONS.findall(p.read_text())}
    return {m for p in JOBS for m in WRITTEN.findall(p.read_text())}, options


def rows_of_results():
    rows = re.compile(r'^ +\{ "([\w<>]+)", RESULT_', re.M)
    return {m for name in ("result_key.c", "mode_key.c")
            for m in rows.findall((TOP / "src/job" / name).read_text())}


def test_every_member_that_a_source_writes_has_its_line_and_every_line_a_source():
    status, text, _ = told_of("result")
    written, options = members()
    listed = set(re.findall(r"^ +(\w+):", text, re.M))
    assert status == 0 and len(written) > 120, written
    assert not written - listed - options
    literal = "\n".join(p.read_text() for p in JOBS)
    named = {r for r in rows_of_results() if not r.startswith("<")}
    assert len(named) > 120 and not {r for r in named if f'"{r}"' not in literal}
    assert not {r for r in rows_of_results() if not re.search(rf"^ +{r}:", text, re.M)}


def test_every_member_of_a_live_event_has_its_line(daemon):
    """Of windows, tracks and alarms as a daemon tells them; modes, stability and diagnostics are
    those of identify."""
    dt, t = 0.01, 0.01 * np.arange(3000)
    rows = np.exp(-0.02 * t) * np.cos(9 * t) + (t > 12) * np.exp(-0.02 * t) * np.cos(20 * t)
    data = memoryview(np.ascontiguousarray(rows, dtype="<f8").tobytes())
    told = {}
    with daemon.client() as client:
        stream = client.ask("STREAM", {"op": "open", "name": "told", "channels": 1, "dt": dt,
                                       "window": {
            "samples": 400, "hop": 100,
            "alarms": {"damping_below": 0.05, "new_mode": True}}})[0]["stream"]
        events = client.events(start=0, stream="told", timeout=PATIENCE)
        # each window is told before the next is there
        for at in range(0, 3000, 100):
            part = data[8 * at:8 * (at + 100)]
            client.ask("STREAM", {"op": "push", "stream": stream, "epoch": 0, "first": at,
                                  "count": 100,
                                  "crc32c": crc32c(part)}, [part])
            while at >= 300:
                event = next(events).header
                assert "error" not in event
                told.setdefault(event["event"], {}).update(event)
                if event["event"] == "modes" and event["to"] == at + 99:
                    break
        client.ask("STREAM", {"op": "close", "stream": stream})
    assert set(told) == {"modes", "track", "alarm"}
    text = told_of("result")[1]
    for kind, event in told.items():
        block = text.split(f"live {kind}", 1)[1].split("\n\n")[0]
        listed = set(re.findall(r"^ +(\w+):", block, re.M))
        inside = {m for name in ("update", "lag", "gaps", "mode") for m in event.get(name, {})}
        assert set(event) | inside <= listed | {"subscription"}, (kind, block)


def codes():
    found = set()
    for path in sorted((TOP / "src").rglob("*.c")):
        source = path.read_text()
        found |= {("identify", c) for c in re.findall(r'identify_diagnose\([^"]*?"(\w+)"', source)}
        found |= {("steady", c) for c in re.findall(r'\bdiagnose\(list, "(\w+)"', source)}
        found |= {("floquet", c) for c in re.findall(r'floquet_diagnose\(result, "(\w+)"', source)}
    return found


def test_every_diagnostic_of_the_source_has_its_line_with_advice_and_no_other_has():
    text = told_of("result")[1].split("\ndiagnostics\n")[1]
    told_codes = set(re.findall(r"^    (\w+): .+\n +of (\w+); \S.+$", text, re.M))
    assert len(told_codes) > 40
    assert {(kind, code) for code, kind in told_codes} == codes()


def test_one_member_is_told_wherever_it_stands():
    status, text, _ = told_of("result", "max_multiplier")
    assert status == 0
    assert re.findall(r"^\w.*$", text, re.M) == [f"{k}.stability.max_multiplier"
                                                 for k in ("identify", "steady", "floquet")]
    assert "of identify; use one more, or leave rank.rule to auto" in told_of("result",
                                                                              "cut_pair")[1]


@pytest.mark.parametrize("words, meant", [(("result", "dampingratio"), "damping_ratio"),
                                          (("results",), "result"), (("scnee",), "scene"),
                                          (("scene", "gaps"), "gap"),
                                          (("scene", "cubic_sprng"), "cubic_spring")])
def test_a_slip_in_what_help_is_asked_for_is_told(words, meant):
    status, _, said = told_of(*words)
    assert status == 2 and f"did you mean {meant}?" in said, said


@pytest.mark.parametrize("topic", ["scene", "result"])
def test_the_page_has_no_line_that_groff_takes_for_its_own_and_all_of_the_help(topic):
    page = (BUILD / f"modald-{topic}.5").read_text()
    shown = page.split(".SH KEYS\n.nf\n")[1].split(".fi\n.SH SEE ALSO")[0]
    assert shown.replace("\\-", "-").replace("\\e", "\\").replace("\\&", "") == told_of(topic)[1]
    assert not re.search(r"^[.']", shown, re.M)


# ---- schemas ----

def schema(topic):
    return json.loads((TOP / "proto" / "schema" / f"{topic}.json").read_text())


@pytest.mark.parametrize("topic", ["scene", "result"])
def test_the_schema_of_proto_is_the_one_of_the_tables(topic):
    """Renew it by: modalctl --json help TOPIC | python3 -m json.tool --no-ensure-ascii --indent
    1"""
    made = subprocess.run([CTL, "--json", "help", topic], capture_output=True, text=True,
                          timeout=PATIENCE, env=environment())
    assert made.returncode == 0 and json.loads(made.stdout) == schema(topic)
    jsonschema.Draft202012Validator.check_schema(schema(topic))


def scenes():
    """Every file of tests/ that is a scene, by its place."""
    for path in sorted((TOP / "tests").rglob("*")):
        if path.is_file() and path.stat().st_size < 1 << 20:
            try:
                scene = json.loads(path.read_bytes())
            except ValueError:
                continue
            if isinstance(scene, dict) and "structure" in scene:
                yield pytest.param(path, id=str(path.relative_to(TOP)))


def run_local(tmp_path, verb, document, *words):
    (tmp_path / "document.json").write_text(json.dumps(document))
    done = subprocess.run([CTL, "--local", "--json", verb, tmp_path / "document.json", *words],
                          capture_output=True, text=True, timeout=PATIENCE, env=environment())
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize("path", scenes())
def test_a_scene_that_is_read_meets_the_schema(path, tmp_path):
    document = json.loads(path.read_bytes())
    status, answer = run_local(tmp_path, "floquet", document, "-o", "hill=false")
    # laws are no concern of the language
    if status == 2 and "linear" not in answer["error"]["message"]:
        pytest.skip(f"refused: {answer['error']['message']}")
    jsonschema.Draft202012Validator(schema("scene")).validate(document)


CHAIN = {"structure": {"type": "chain", "masses": [1, 2], "springs": [30, 20, 0],
                       "dampers": [0.1, 0.1, 0]}, "omega": 3.0,
         "effects": [{"type": "gap", "dof": "x1", "stiffness": 50, "clearance": 0.02}],
         "excitation": [{"dof": "x2", "cos": 1.0}],
         "initial": {"x": {"x1": 0.1}}, "time": {"dt": 0.02, "duration": 20}}
LINEAR = {**CHAIN, "effects": [{"type": "parametric_stiffness", "dof": "x1", "stiffness": 1.0}]}
WRONG = [{"structure": {**CHAIN["structure"], "mases": [1]}},
         {"structure": {"type": "chian", "masses": [1], "springs": [1, 0]}},
         {"structure": {"type": "chain", "springs": [1, 0]}}, {"omega": -1}, {"omega": "3"},
         {"effects": [{"type": "gap", "dof": "x1", "stiffness": 50}]},
         {"effects": [{"type": "gap", "dof": "x1", "stiffness": -50, "clearance": 0}]},
         {"effects": [{"dof": "x1"}]}, {"tmie": {}},
         {"excitation": [{"dof": "x2", "cso": 1}]},
         {"excitation": [{"type": "impulse", "dof": "x2"}]}, {"time": {"dt": 0}},
         {"steady": {"harmonix": 3}},
         {"steady": {"harmonics": 3.5}}, {"sensors": [{"dof": "x1", "derivative": 3}]},
         {"structure": {"type": "matrices", "M": [[1]]}},
         {"structure": {"type": "matrices", "M": [[1]], "K": [[1]], "G": [[0]]}}]


def test_the_schema_takes_the_scene_that_is_changed_below():
    jsonschema.Draft202012Validator(schema("scene")).validate(CHAIN)


@pytest.mark.parametrize("change", WRONG, ids=lambda c: json.dumps(c)[:60])
def test_what_the_parser_refuses_for_its_keys_the_schema_refuses(change, tmp_path):
    document = {**CHAIN, **change}
    assert (run_local(tmp_path, "steady", document)[0] == 2
            or run_local(tmp_path, "simulate", document, "-O", tmp_path / "x.h5")[0] == 2)
    assert not jsonschema.Draft202012Validator(schema("scene")).is_valid(document)


def decay(tmp_path):
    t = np.arange(600) * 0.02
    y = np.column_stack([np.exp(-0.05 * t) * np.cos(6 * t) + 0.5 * np.exp(-0.1 * t)
                         * np.cos(15 * t), np.exp(-0.05 * t) * np.cos(6 * t + 1)])
    np.savetxt(tmp_path / "y.csv", np.column_stack([t, y]), delimiter=",", header="t,a,b",
               comments="")
    return tmp_path / "y.csv"


SWEEP = {"scene": LINEAR, "grid": [{"path": "effects[0].stiffness", "values": [1, 2]}]}
RESULTS = [("steady", CHAIN), ("steady", CHAIN, "-o", "solutions=all", "time=true"),
           ("steady", CHAIN, "--sweep", "omega=2:3:3"),
           ("steady", CHAIN, "--continue", "omega=2:2.2", "-o", "harmonics=5"),
           ("steady", {**CHAIN, "effects": []}, "-o", "backbone=1:0.01:0.1:3"),
           ("simulate", CHAIN, "-O", "OUT"), ("floquet", LINEAR),
           ("floquet", {**LINEAR, "effects": []}), ("ablate", CHAIN),
           ("ablate", {**LINEAR, "excitation": []}),
           ("sweep", SWEEP), ("sweep", {**SWEEP, "verb": "steady"}),
           ("sweep", {**SWEEP, "verb": "identify"}),
           ("sweep", {"scene": CHAIN, "grid": [{"path": "effects[0].stiffness", "values": [1]}]})]


@pytest.mark.parametrize("case", RESULTS, ids=lambda c: f"{c[0]} {' '.join(c[2:])}")
def test_a_real_result_meets_the_schema(case, tmp_path):
    verb, document, *words = case
    status, answer = run_local(tmp_path, verb, document,
                               *[tmp_path / "out.h5" if w == "OUT" else w for w in words])
    assert status in (0, 1), answer
    jsonschema.Draft202012Validator(schema("result")).validate(answer)


@pytest.mark.parametrize("words",
                         [(), ("-o", "shapes=true"),
                          ("-o", "period=1.0471975511965976", "shapes=true"),
                          ("-o", "target.error=1e-3")], ids=" ".join)
@pytest.mark.parametrize("verb", [("identify",), ("tradeoff", "identify")], ids=" ".join)
def test_a_real_result_of_signals_meets_the_schema(verb, words, tmp_path):
    done = subprocess.run([CTL, "--local", "--json", *verb, decay(tmp_path), *words],
                          capture_output=True, text=True, timeout=PATIENCE, env=environment())
    assert done.returncode == 0, done.stdout
    jsonschema.Draft202012Validator(schema("result")).validate(json.loads(done.stdout))


@pytest.mark.parametrize("of", ["steady", "simulate"])
def test_a_real_tradeoff_of_a_scene_meets_the_schema(of, tmp_path):
    (tmp_path / "document.json").write_text(json.dumps(CHAIN))
    done = subprocess.run([CTL, "--local", "--json", "tradeoff", of, tmp_path / "document.json"],
                          capture_output=True, text=True, timeout=PATIENCE, env=environment())
    assert done.returncode == 0, done.stdout
    jsonschema.Draft202012Validator(schema("result")).validate(json.loads(done.stdout))


def test_a_result_with_a_member_that_is_not_told_is_refused_by_the_schema(tmp_path):
    _, answer = run_local(tmp_path, "floquet", LINEAR)
    validator = jsonschema.Draft202012Validator(schema("result"))
    assert validator.is_valid(answer) and not validator.is_valid({**answer, "news": 1})
    answer["stability"]["margin"] = "0.1"
    assert not validator.is_valid(answer)
