"""The monitor as an FMI 2.0 unit, driven as an importer does: by its description alone, in a
process of its own.
"""
import ctypes
import os
import re
import subprocess
import sys
import xml.etree.ElementTree
import zipfile

import numpy as np
import pytest

import sanitized
from conftest import BUILD, PATIENCE, environment

FMU = BUILD / "modald-monitor.fmu"
pytestmark = pytest.mark.skipif(sanitized.SANITIZED,
                                reason="an importer is not built with sanitizers")
FUNCTIONS = re.findall(r"fmi2\w+", """
    fmi2GetTypesPlatform fmi2GetVersion fmi2SetDebugLogging fmi2Instantiate fmi2FreeInstance
    fmi2SetupExperiment fmi2EnterInitializationMode fmi2ExitInitializationMode fmi2Terminate
    fmi2Reset fmi2GetReal fmi2GetInteger fmi2GetBoolean fmi2GetString fmi2SetReal fmi2SetInteger
    fmi2SetBoolean fmi2SetString fmi2GetFMUstate fmi2SetFMUstate fmi2FreeFMUstate
    fmi2SerializedFMUstateSize fmi2SerializeFMUstate fmi2DeSerializeFMUstate
    fmi2GetDirectionalDerivative fmi2SetRealInputDerivatives fmi2GetRealOutputDerivatives
    fmi2DoStep fmi2CancelStep fmi2GetStatus fmi2GetRealStatus fmi2GetIntegerStatus
    fmi2GetBooleanStatus fmi2GetStringStatus""")     # all that the standard wants of co-simulation


class Unit:
    def __init__(self, folder, name="unit"):
        with zipfile.ZipFile(FMU) as archive:
            archive.extractall(folder)
        root = xml.etree.ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.guid = root.get("guid")
        identifier = root.find("CoSimulation").get("modelIdentifier")
        self.variables = {v.get("name"): int(v.get("valueReference")) for v in root.iter(
            "ScalarVariable")}
        self.outputs = [list(self.variables)[int(u.get("index")) - 1] for u in root.iter("Unknown")]
        self.path = folder / "binaries" / "linux64" / f"{identifier}.so"
        self.library = ctypes.CDLL(str(self.path))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        self.library.fmi2GetVersion.restype = ctypes.c_char_p
        self.name, self.unit = name, None

    def begin(self, guid=None):
        made = self.library.fmi2Instantiate(self.name.encode(), 1, (guid or self.guid).encode(),
                                            b"", None, 0, 0)
        self.unit = ctypes.c_void_p(made)
        return made is not None

    def do(self, function, *more):
        return getattr(self.library, function)(self.unit, *more)

    def move(self, verb, kind, names, values):
        of = {"Real": ctypes.c_double, "Integer": ctypes.c_int}[kind]
        n = len(names)
        data = (of * n)(*values)
        status = self.do(f"fmi2{verb}{kind}", (ctypes.c_uint * n)(*map(self.variables.get, names)),
                         ctypes.c_size_t(n), data)
        assert status == 0, (verb, names)
        return list(data)


def drive(folder, damping):
    """A host: an oscillator of 3 Hz seen by all inputs, until there is a verdict."""
    import pathlib
    import time
    unit, dt, w = Unit(pathlib.Path(folder)), 0.01, 6 * np.pi
    assert unit.begin()
    unit.move("Set", "Real", ["dt"], [dt])
    unit.move("Set", "Integer", ["window", "hop"], [400, 200])
    assert unit.do("fmi2SetupExperiment", 0, ctypes.c_double(0), ctypes.c_double(0), 0,
                   ctypes.c_double(0)) == 0
    unit.do("fmi2EnterInitializationMode")
    unit.do("fmi2ExitInitializationMode")
    inputs = [name for name in unit.variables if name.startswith("u[")]
    noise, end, k = np.random.default_rng(2), time.monotonic() + PATIENCE, 0
    while unit.move("Get", "Integer", ["verdict"], [0])[0] in (0, 3):
        assert time.monotonic() < end, "no verdict"
        for _ in range(100):
            t = k * dt
            size = np.exp(-damping * w * (t % 8))        # struck anew before it is gone
            y = size * np.cos(w * np.sqrt(1 - damping ** 2) * (t % 8)
                              + np.arange(len(inputs))) + 1e-4 * noise.standard_normal(len(inputs))
            unit.move("Set", "Real", inputs, y)
            assert unit.do("fmi2DoStep", ctypes.c_double(t), ctypes.c_double(dt), 1) == 0
            k += 1
        time.sleep(0.05)
    print(unit.move("Get", "Integer", ["verdict"], [0])[0],
          *unit.move("Get", "Real", ["frequency_hz", "frequency_std", "damping_ratio",
                                     "damping_std"], [0] * 4))
    unit.do("fmi2Terminate")
    unit.library.fmi2FreeInstance(unit.unit)


def host(folder, damping, **env):
    done = subprocess.run(["/usr/bin/python3", __file__, str(folder), str(damping)],
                          capture_output=True, text=True, timeout=PATIENCE,
                          env=environment(PYTHONPATH=os.pathsep.join(sys.path), **env), check=False)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def test_the_unit_has_all_that_the_standard_wants_and_shows_nothing_else(tmp_path):
    path = Unit(tmp_path).path
    shown = subprocess.run(["nm", "-D", "--defined-only", str(path)], capture_output=True,
                           text=True, check=True).stdout
    assert {line.split()[-1] for line in shown.splitlines()} == set(FUNCTIONS)


def test_the_description_names_what_the_unit_takes_and_gives(tmp_path):
    unit = Unit(tmp_path)
    assert unit.outputs == ["frequency_hz", "frequency_std", "damping_ratio", "damping_std",
                            "verdict"]
    assert unit.library.fmi2GetVersion() == b"2.0"
    inputs = [name for name in unit.variables if name.startswith("u[")]
    assert inputs == [f"u[{i + 1}]" for i in range(len(inputs))] and inputs
    assert len(set(unit.variables.values())) == len(unit.variables)
    assert not unit.begin("{another}") and unit.begin()
    beyond = (ctypes.c_uint * 1)(max(unit.variables.values()) + 1)
    assert unit.do("fmi2SetReal", beyond, ctypes.c_size_t(1), (ctypes.c_double * 1)()) != 0
    assert unit.do("fmi2GetReal", beyond, ctypes.c_size_t(1), (ctypes.c_double * 1)()) != 0
    unit.library.fmi2FreeInstance(unit.unit)


@pytest.mark.parametrize("damping, verdict", [(0.01, 1), (-0.004, 2)])
def test_a_master_reads_frequency_damping_and_verdict_of_what_it_sends(damping, verdict, daemon,
                                                                       tmp_path):
    found = host(tmp_path, damping, MODALD_URL=daemon.endpoint, MODALD_CLOSE_WAIT="5")
    assert found[0] == verdict
    assert abs(found[1] - 3) < 5 * found[2] + 1e-4 and abs(found[3] - damping) < 5 * found[4] + 1e-4


if __name__ == "__main__":
    drive(sys.argv[1], float(sys.argv[2]))
