"""A scene through `modalctl --local`, for tests of laws."""
import json
import subprocess

import numpy as np
from conftest import BUILD, PATIENCE, environment


def call(tmp_path, verb, scene, *words):
    """The exit status and the document."""
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    done = subprocess.run([BUILD / "bin" / "modalctl", "--local", "--json", verb,
                           tmp_path / "scene.json", *words], capture_output=True, text=True,
                          timeout=PATIENCE, env=environment())
    return done.returncode, json.loads(done.stdout)


def run(tmp_path, verb, scene, *words):
    """The document of what must end well."""
    code, answer = call(tmp_path, verb, scene, *words)
    assert code == 0, answer
    return answer


def harmonics(answer):
    """X_k of each reported dof, a row each."""
    return np.array([np.array(row["re"]) + 1j * np.array(row["im"]) for row in answer["harmonics"]])
