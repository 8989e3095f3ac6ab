"""A word that is one slip away from one that there is, is asked after wherever words are read; one
that is far from all is not."""
import json
import subprocess

import h5py
import numpy as np
import pytest
from conftest import BUILD, PATIENCE, environment

SCENE = {"structure": {"type": "chain", "masses": [1], "springs": [1, 0]}, "omega": 1.3,
         "excitation": [{"dof": "x1", "cos": 1}],
         "effects": [{"type": "damper", "dof": "x1", "coefficient": 0.1}]}


def refused(tmp_path, program, *words):
    done = subprocess.run([BUILD / "bin" / program, *map(str, words)], capture_output=True,
                          text=True, timeout=PATIENCE,
                          env=environment(), cwd=tmp_path)
    assert done.returncode == 2, done
    return done.stderr


def changed(**change):
    return json.dumps({**SCENE, **change})


def slips():
    chain, damper, load = SCENE["structure"], SCENE["effects"][0], SCENE["excitation"][0]
    yield "a verb", ["identfy", "x.h5"], "identify"
    yield "a verb, letters exchanged", ["setady", "s.json"], "steady"
    yield "an option", ["steady", "s.json", "--swepe", "omega=1:2:3"], "--sweep"
    yield "an option with its value", ["steady", "s.json", "--sweeep=omega=1:2:3"], "--sweep"
    yield "a key of -o", ["steady", "s.json", "-o", "harmonix=3"], "harmonics"
    yield "a word of -o", ["steady", "s.json", "-o", "method=newtn"], "newton"
    yield "a path", ["steady", "s.json", "--sweep", "omga=1:2:3"], "omega"
    yield "a path inside", ["steady", "s.json", "--sweep", "structure.masess[0]=1:2:3"], "masses"
    yield "of a tradeoff", ["tradeoff", "stedy", "s.json"], "steady"
    yield "an array", ["identify", "y.h5", "--dataset", "acel"], "accel"
    yield "a topic", ["help", "scenes"], "scene"
    yield "a channel", ["identify", "named.h5", "-o", "signals=tipp"], "tip"
    named = {"type": "matrices", "M": [[1, 0], [0, 1]], "K": [[2, -1], [-1, 2]],
             "dofs": ["hub", "blade"]}
    yield "a dof of an effect", ["steady",
                                 {"structure": named,
                                  "effects": [{**SCENE["effects"][0], "dof": "hbu"}]}], "hub"
    yield "a dof of a report", ["steady", {"structure": named, "effects": [],
                                           "excitation": [{"dof": "hub", "cos": 1}],
                                           "steady": {"dofs": ["blad"]}}], "blade"
    yield "a dof of the start", ["steady", {"structure": named, "effects": [], "excitation": [],
                                            "initial": {"x": {"Blade": 1}}}], "blade"
    for name, change, meant in [
            ("key", {"exitation": []}, "excitation"),
            ("structure", {"structure": {**chain, "type": "chian"}}, "chain"),
            ("structure key", {"structure": {**chain, "damper": [0, 0]}}, "dampers"),
            ("effect", {"effects": [{**damper, "type": "dampr"}]}, "damper"),
            ("effect key", {"effects": [{**damper, "coeficient": 1}]}, "coefficient"),
            ("load", {"excitation": [{**load, "type": "impulze"}]}, "impulse"),
            ("load key", {"excitation": [{**load, "sni": 1}]}, "sin"),
            ("steady key", {"steady": {"stabilty": True}}, "stability"),
            ("time key", {"time": {"duraton": 1}}, "duration")]:
        yield f"a scene's {name}", ["steady", change], meant


@pytest.mark.parametrize("words, meant", [pytest.param(w, m, id=n) for n, w, m in slips()])
def test_a_slip_is_asked_after(tmp_path, words, meant):
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    with h5py.File(tmp_path / "y.h5", "w") as file:
        file["accel"] = np.random.default_rng(5).normal(size=(50, 2))
        file["velocity"] = np.zeros((50, 2))
    with h5py.File(tmp_path / "named.h5", "w") as file:
        signals = file.create_dataset("signals", data=np.random.default_rng(5).normal(size=(50, 2)))
        signals.attrs.update({"dt": 0.1, "channels": ["root", "tip"]})
    if isinstance(words[-1], dict):
        (tmp_path / "wrong.json").write_text(changed(**words[-1]))
        words = [*words[:-1], "wrong.json"]
    said = refused(tmp_path, "modalctl", "--local", *words)
    assert f"; did you mean {meant}?" in said, said


@pytest.mark.parametrize("words", [["xyzzy"], ["steady", "s.json", "--xyzzy"],
                                   ["steady", "s.json", "-o", "xyzzy=1"],
                                   ["steady", "s.json", "-o", "method=xyzzy"]])
def test_what_is_like_nothing_is_not_guessed_at(tmp_path, words):
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    said = refused(tmp_path, "modalctl", "--local", *words)
    assert "did you mean" not in said and ("accepted: " in said or "list them" in said), said


@pytest.mark.parametrize("words, meant",
                         [(["--wokers", "2"], "workers"),
                          (["--config", "modald.conf", "--check-config"], "workers")])
def test_a_slip_in_the_daemons_arguments_and_configuration_is_asked_after(tmp_path, words, meant):
    (tmp_path / "modald.conf").write_text("data = /nowhere\nwrokers = 2\n")
    said = refused(tmp_path, "modald", *words)
    assert f"; did you mean {meant}?; accepted: " in said, said


def test_a_kind_that_the_daemon_does_not_know_is_asked_after(ctl, daemon, tmp_path):
    (tmp_path / "list.jsonl").write_text(json.dumps({"kind": "stedy",
                                                     "file": str(tmp_path / "s.json")}) + "\n")
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    for words in (["submit", "stedy", tmp_path / "s.json"],
                  ["submit", "--from", tmp_path / "list.jsonl"]):
        said = ctl(*words, server=daemon, one=False)
        assert (said.status == 2 and "did you mean steady?; accepted: identify, "
                in said.out), (said.out, said.err)


def test_a_dof_of_another_number_is_no_slip(tmp_path):
    (tmp_path / "wrong.json").write_text(changed(
        structure={"type": "chain", "masses": [1] * 20, "springs": [1] * 20 + [0]},
        effects=[{**SCENE["effects"][0], "dof": "x99"}]))
    said = refused(tmp_path, "modalctl", "--local", "steady", "wrong.json")
    assert 'no dof "x99" in this structure; its dofs run from x1 to x20' in said


def test_a_number_in_place_of_a_dofs_name_is_told_the_names(tmp_path):
    (tmp_path / "wrong.json").write_text(changed(
        structure={"type": "chain", "masses": [1] * 20, "springs": [1] * 20 + [0]},
        effects=[{**SCENE["effects"][0], "dof": 3}]))
    said = refused(tmp_path, "modalctl", "--local", "steady", "wrong.json")
    assert 'dof is 3; accepted: the name of a dof; they run from "x1" to "x20"' in said


def test_a_slip_in_a_role_is_asked_after(tmp_path):
    key = "3HsCIKXTD=m]fq6PH.y&T&02][FEcKq$duR0@0Z4"
    for name, text in (("server.key", f'public-key = "{key}"\nsecret-key = "{key}"\n'),
                       ("keys", f"{key} ann sumbit\n")):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o600)
    (tmp_path / "modald.conf").write_text("data = d\nserver_key = server.key\nkeys = keys\n")
    said = refused(tmp_path, "modald", "--check-config", "--config", "modald.conf")
    assert "; did you mean submit?; accepted: read, submit, admin, worker" in said
