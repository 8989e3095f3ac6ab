"""A word that is one slip away from one that there is, is asked after wherever words are read; one that is far from all is not."""
import json
import subprocess

import h5py
import numpy as np
import pytest
from conftest import BUILD, PATIENCE, environment

SCENE = {"structure": {"type": "chain", "masses": [1], "springs": [1, 0]}, "omega": 1.3, "excitation": [{"dof": "x1", "cos": 1}],
         "effects": [{"type": "damper", "dof": "x1", "coefficient": 0.1}]}


def refused(tmp_path, program, *words):
    done = subprocess.run([BUILD / "bin" / program, *map(str, words)], capture_output=True, text=True, timeout=PATIENCE,
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
    for name, change, meant in [
            ("key", {"exitation": []}, "excitation"), ("structure", {"structure": {**chain, "type": "chian"}}, "chain"),
            ("structure key", {"structure": {**chain, "damper": [0, 0]}}, "dampers"), ("effect", {"effects": [{**damper, "type": "dampr"}]}, "damper"),
            ("effect key", {"effects": [{**damper, "coeficient": 1}]}, "coefficient"), ("load", {"excitation": [{**load, "type": "impulze"}]}, "impulse"),
            ("load key", {"excitation": [{**load, "sni": 1}]}, "sin"), ("steady key", {"steady": {"stabilty": True}}, "stability"),
            ("time key", {"time": {"duraton": 1}}, "duration")]:
        yield f"a scene's {name}", ["steady", change], meant


@pytest.mark.parametrize("words, meant", [pytest.param(w, m, id=n) for n, w, m in slips()])
def test_a_slip_is_asked_after(tmp_path, words, meant):
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    with h5py.File(tmp_path / "y.h5", "w") as file:
        file["accel"] = np.random.default_rng(5).normal(size=(50, 2))
        file["velocity"] = np.zeros((50, 2))
    if isinstance(words[-1], dict):
        (tmp_path / "wrong.json").write_text(changed(**words[-1]))
        words = [*words[:-1], "wrong.json"]
    said = refused(tmp_path, "modalctl", "--local", *words)
    assert f"; did you mean {meant}?" in said, said


@pytest.mark.parametrize("words", [["xyzzy"], ["steady", "s.json", "--xyzzy"], ["steady", "s.json", "-o", "xyzzy=1"], ["steady", "s.json", "-o", "method=xyzzy"]])
def test_what_is_like_nothing_is_not_guessed_at(tmp_path, words):
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    said = refused(tmp_path, "modalctl", "--local", *words)
    assert "did you mean" not in said and ("accepted: " in said or "list them" in said), said


@pytest.mark.parametrize("words, meant", [(["--wokers", "2"], "workers"), (["--config", "modald.conf", "--check-config"], "workers")])
def test_a_slip_in_the_daemons_arguments_and_configuration_is_asked_after(tmp_path, words, meant):
    (tmp_path / "modald.conf").write_text("data = /nowhere\nwrokers = 2\n")
    said = refused(tmp_path, "modald", *words)
    assert f"; did you mean {meant}?; accepted: " in said, said


def test_a_kind_that_the_daemon_does_not_know_is_asked_after(ctl, daemon, tmp_path):
    (tmp_path / "list.jsonl").write_text(json.dumps({"kind": "stedy", "file": str(tmp_path / "s.json")}) + "\n")
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    for words in (["submit", "stedy", tmp_path / "s.json"], ["submit", "--from", tmp_path / "list.jsonl"]):
        said = ctl(*words, server=daemon, one=False)
        assert said.status == 2 and "did you mean steady?; accepted: identify, " in said.out, (said.out, said.err)
