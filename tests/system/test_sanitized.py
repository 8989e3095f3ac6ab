"""The net under all other tests: a planted fault in any process is a report that its test would
fail by.
"""
import subprocess

import pytest
import sanitized
from wire import Daemon

pytestmark = pytest.mark.skipif(not sanitized.SANITIZED,
                                reason="a build without sanitizers reports nothing")
PLANTED = {"overflow": "volatile char *p = malloc(7); return p[7];",
           "leak": "volatile char *p = malloc(7); p = 0; return 0;",
           "undefined": "volatile int n = 2147483647; n++; return 0;"}
SAID = {"overflow": "heap-buffer-overflow", "leak": "LeakSanitizer", "undefined": "runtime error"}


@pytest.fixture
def planted(tmp_path):
    def build(fault, name):
        """A program as ours are made, called NAME so that it reports as that one does."""
        subprocess.run(["cc", "-x", "c", "-", "-fsanitize=address,undefined",
                        "-fno-sanitize-recover=undefined", "-o", tmp_path / name], check=True,
                       input=f"#include <stdlib.h>\nint main(void) {{ {PLANTED[fault]} }}\n",
                       text=True)
        return tmp_path / name
    return build


@pytest.mark.parametrize("fault", ["overflow", "leak"])
@pytest.mark.parametrize("name", ["modald", "modalctl"])
def test_a_fault_of_a_program_is_reported_though_nobody_reads_its_stderr(name, fault, planted):
    assert (subprocess.run([planted(fault, name)], stderr=subprocess.DEVNULL).returncode
            == sanitized.STATUS)
    report, = sanitized.reports()
    assert SAID[fault] in report


def test_undefined_behaviour_is_heard_from_stderr(planted):
    """gcc's library for it knows no file for its reports."""
    done = subprocess.run([planted("undefined", "modald")], stderr=subprocess.PIPE, text=True)
    assert done.returncode == sanitized.STATUS
    sanitized.hear(done.stderr)
    report, = sanitized.reports()
    assert SAID["undefined"] in report


@pytest.mark.parametrize("fault", PLANTED)
def test_a_workers_fault_is_reported_through_the_daemons_log(fault, planted):
    with Daemon(config=f"worker_path = {planted(fault, 'modald-worker')}\n", workers=1) as daemon:
        daemon.client().ask("HELLO")
        while "event=worker_exit" not in daemon.text():
            daemon.client().ask("HELLO")
    found = sanitized.reports()
    assert found and SAID[fault] in found[0]
