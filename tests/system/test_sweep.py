"""A sweep through the daemon: shared over the workers, the table of --local, a kill -9 in the
middle, cancel.
"""
import contextlib
import csv
import json
import math
import subprocess
import time

import pytest
from conftest import BUILD, PATIENCE, TOP, environment

import modald
import wire

EI, M = 6570.0, 3.24                        # N m^2, kg/m, of a beam of 1 m
W1, P1 = math.pi ** 2 * math.sqrt(EI / M), math.pi ** 2 * EI


def strutt(points, elements=0, **options):
    """Strutt's diagram, POINTS x POINTS over mu and omega: of one damped mode, or of the beam of
    ELEMENTS.
    """
    mu, omega = ([low + (high - low) * (i + 0.5) / points for i in range(points)]
                 for low, high in ((0, 0.45), (0.4, 1.4)))
    if elements:
        structure = {"type": "beam", "length": 1, "elements": elements, "EI": EI,
                     "mass_per_length": M}
        effect, key, scale = {"type": "axial_load", "amplitude": P1}, "amplitude", 2 * P1
    else:
        structure = {"type": "matrices", "M": [[1]], "K": [[W1 ** 2]], "C": [[12.57]]}
        effect, key, scale = {"type": "parametric_stiffness", "dof": "x1",
                              "stiffness": 1}, "stiffness", -2 * W1 ** 2
    return {"verb": "floquet",
            "scene": {"structure": structure, "omega": 2 * W1, "effects": [effect]},
            "options": options,
            "grid": [{"path": f"effects[0].{key}", "values": [scale * m for m in mu]},
                     {"path": "omega", "values": [2 * W1 * o for o in omega]}]}


def write(tmp_path, document):
    path = tmp_path / "sweep.json"
    path.write_text(json.dumps(document))
    return path


def start(daemon, path):
    return subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint,
                             "--json", "sweep", str(path), "--wait"],
                            stdout=subprocess.PIPE, text=True, env=environment())


def table(result):
    """Everything but what a run cost."""
    return {key: value for key, value in result.items() if key != "cost"}


def jobs(client, **which):
    return {job["job"]: job for job in client.list(kind="sweep", **which)}


def until_done(client, count):
    end = time.monotonic() + PATIENCE
    while len(found := jobs(client, state="done")) < count:
        assert time.monotonic() < end, found
        time.sleep(0.02)
    return found


def test_the_shares_give_the_table_of_one_process(ctl, own_daemon, tmp_path):
    daemon, path = own_daemon(), write(tmp_path, strutt(13))
    local, served = ctl("sweep", path).document, ctl("sweep", path, "--wait",
                                                     server=daemon).document
    assert table(served) == table(local) and len(local["points"]) == 169
    assert [p["index"] for p in served["points"]] == [[i, j] for i in range(13) for j in range(13)]
    # the first tongue is around omega = 1, half as wide as mu: unstable at the diagram's middle,
    # stable left of it
    stable = {tuple(p["index"]): p["stability"]["stable"] for p in served["points"]}
    assert stable[6, 7] is False and stable[6, 3] is True
    with daemon.client() as client:
        assert len(jobs(client)) > 2 * daemon.workers
    assert served["cost"]["stages"]["points"] > 0


def test_a_grid_of_one_point_is_a_sweep(ctl, daemon, tmp_path):
    path = write(tmp_path, strutt(1))
    assert (table(ctl("sweep", path, "--wait", server=daemon).document)
            == table(ctl("sweep", path).document))


def test_a_share_is_a_job_of_its_own(ctl, daemon, tmp_path):
    path = write(tmp_path, strutt(5))
    served = ctl("sweep", path, "--wait", "-o", "first=7", "count=3", server=daemon).document
    assert [p["index"] for p in served["points"]] == [[1, 2], [1, 3], [1, 4]]


@pytest.mark.parametrize("masses", [3, 100])
def test_progress_is_told_without_the_points_that_would_make_it_too_long(daemon, masses):
    """A job's first chunk, a point that has the harmonics of each mass, is always told of."""
    chain = {"type": "chain", "masses": [1] * masses, "springs": [1] * (masses + 1),
             "dampers": [0.1] * (masses + 1)}
    sweep = {"verb": "steady", "grid": [{"path": "omega", "values": [0.5]}], "options": {},
             "scene": {"structure": chain, "omega": 0.5,
                       "excitation": [{"dof": "x1", "k": 1, "cos": 0.1}]}}
    told = []
    with daemon.client() as client, contextlib.closing(wire.Client(daemon.endpoint)) as watcher:
        assert watcher.ask("EVENTS").ok                 # before: progress is not told afterwards
        job = client.submit("sweep", sweep)
        while not told or told[-1].get("state") not in ("done", "failed", "dead"):
            event = watcher.early.pop(0) if watcher.early else watcher.receive()
            if event.get("job") == job.id:
                told.append(event.header)
        points = job.result(PATIENCE)["points"]
    progress, = [e["progress"] for e in told if e.get("event") == "progress"]
    assert {k: progress.pop(k) for k in ("fraction", "done", "total", "first", "count")} == {
        "fraction": 1, "done": 1, "total": 1, "first": 0, "count": 1}
    assert (len(json.dumps(points, separators=(",", ":"))) > 4096) == (masses == 100)
    assert progress == ({"points": points} if masses == 3 else {})


def test_an_error_of_a_point_stays_in_its_row(ctl, daemon, tmp_path):
    document = strutt(3)
    document["grid"][1]["values"][1] = -1
    path = write(tmp_path, document)
    local, served = ctl("sweep", path).document, ctl("sweep", path, "--wait",
                                                     server=daemon).document
    assert table(served) == table(local)
    assert [p["index"] for p in served["points"] if "error" in p] == [[i, 1] for i in range(3)]


def test_a_bad_document_is_2_by_name_and_no_job(ctl, own_daemon, tmp_path):
    daemon, document = own_daemon(workers=1), strutt(3)
    document["grid"][0]["path"] = "effects[4].stiffness"
    for words in ([], ["--wait"]):
        said = ctl("sweep", write(tmp_path, document), *words, server=daemon)
        assert said.status == 2 and said.document["error"]["field"] == "grid[0].path"
    with daemon.client() as client:
        assert not jobs(client)


def test_without_wait_the_jobs_are_named_and_found_again(ctl, own_daemon, tmp_path):
    daemon, path = own_daemon(), write(tmp_path, strutt(13))
    first = ctl("sweep", path, server=daemon).document
    assert (first["kind"] == "sweep" and first["points"] == 169
            and all(job["state"] for job in first["jobs"]))
    served = ctl("sweep", path, "--wait", server=daemon).document
    again = ctl("sweep", path, server=daemon).document
    assert ([j["job"] for j in again["jobs"]] == [j["job"] for j in first["jobs"]]
            and again["done"] == 169)
    assert all(j["attempts"] == 1 and j["duplicate"] for j in again["jobs"])
    with daemon.client() as client:
        assert jobs(client).keys() == {j["job"] for j in first["jobs"]}
    assert len(served["points"]) == 169


def test_python_gives_the_same_table_and_finds_its_jobs_again(ctl, own_daemon, tmp_path):
    daemon, document = own_daemon(), strutt(13)
    local = ctl("sweep", write(tmp_path, document)).document
    with daemon.client() as client:
        first, again = client.sweep(document), client.sweep(document)
        assert len(jobs(client)) == 64
    assert first == again and first["points"] == local["points"] and first["total"] == 169
    assert first["provenance"]["options"] == local["provenance"]["options"]


def test_python_leaves_a_timeout_s_jobs_and_replaces_cancelled_ones(own_daemon):
    daemon, document = own_daemon(workers=1), strutt(24, elements=2, tolerance=1e-9)
    with daemon.client() as client:
        with pytest.raises(modald.Error) as why:
            client.sweep(document, timeout=0.01)
        assert why.value.code == "timeout"
        for job in jobs(client, state="queued"):
            client.cancel(job)
        assert jobs(client, state="cancelled")
        assert len(client.sweep(document)["points"]) == 576


def test_a_kill_in_the_middle_computes_no_finished_share_again(ctl, own_daemon, tmp_path):
    daemon, path = own_daemon(), write(tmp_path, strutt(32, elements=2, tolerance=1e-9))
    waiting = start(daemon, path)
    with daemon.client() as client:
        before = until_done(client, 8)
        daemon.kill()
        assert waiting.poll() is None, "over before the kill"
        daemon.start()
        out, _ = waiting.communicate(timeout=PATIENCE)
        after = jobs(client)
    assert waiting.returncode == 0
    assert all((after[job]["attempts"], after[job]["finished"]) == (1, doc["finished"])
               for job, doc in before.items())
    # no share twice, and those that ran at the kill once more: at most one a worker
    assert len(after) == 64 and {job["state"] for job in after.values()} == {"done"}
    assert sum(job["attempts"] for job in after.values()) <= 64 + daemon.workers
    assert table(json.loads(out)) == table(ctl("sweep", path).document)


def test_cancel_ends_the_sweep_and_another_goes_on_from_there(ctl, own_daemon, tmp_path):
    daemon, path = own_daemon(), write(tmp_path, strutt(32, elements=2, tolerance=1e-9))
    assert ctl("sweep", path, "--cancel", server=daemon).status == 4
    waiting = start(daemon, path)
    with daemon.client() as client:
        until_done(client, 4)
        while len(jobs(client)) < 64:
            time.sleep(0.02)
        said = ctl("sweep", path, "--cancel", server=daemon)
        assert (said.status == 0
                and {job["state"] for job in said.document["jobs"]} == {"done", "cancelled"})
        out, _ = waiting.communicate(timeout=PATIENCE)
        assert waiting.returncode == 1 and json.loads(out)["error"]["code"] == "cancelled"
        done = jobs(client, state="done")
        assert (4 <= len(done) < 64 and not jobs(client, state="queued")
                and not jobs(client, state="running"))
        served = ctl("sweep", path, "--wait", server=daemon)
        assert served.status == 0 and len(served.document["points"]) == 1024
        after = jobs(client, state="done")
        assert (len(after) == 64
                and all(after[job]["finished"] == doc["finished"] for job, doc in done.items()))


def test_a_passed_timeout_is_5_and_leaves_the_jobs(ctl, own_daemon, tmp_path):
    daemon, path = own_daemon(workers=1), write(tmp_path, strutt(32, elements=2, tolerance=1e-9))
    with daemon.client() as client:
        assert ctl("sweep", path, server=daemon).status == 0
        assert ctl("sweep", path, "--wait", "--timeout", "0.5", server=daemon).status == 5
        assert jobs(client, state="queued") and not jobs(client, state="cancelled")
        assert ctl("sweep", path, "--cancel", server=daemon).status == 0


def test_strutt_s_diagram_of_40000_points_lies_within_the_reference_boundaries(ctl, own_daemon,
                                                                               tmp_path):
    """At the reference's mu each point 1e-6 inside a tongue is unstable, each 1e-6 outside of all
    is not.
    """
    with open(TOP / "tests/data/beam/strutt_undamped.csv") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)
                if row["omega_low"]]
    known = {row["mu"] for row in rows}
    mu = sorted(known | {0.45 * (i + 0.31) / (200 - len(known)) for i in range(200 - len(known))})
    omega = [0.3 + 1.1 * (i + 0.5) / 200 for i in range(200)]
    document = strutt(1)
    del document["scene"]["structure"]["C"]
    document["grid"][0]["values"], document["grid"][1]["values"] = [-2 * W1 ** 2 * m
                                                                    for m in mu], [2 * W1 * o
                                                                                   for o in omega]
    daemon = own_daemon()
    served = ctl("sweep", write(tmp_path, document), "--wait", server=daemon).document
    assert len(served["points"]) == len(mu) * len(omega) == 40000
    checked = 0
    for point in served["points"]:
        m, o = mu[point["index"][0]], omega[point["index"][1]]
        tongues = [(row["omega_low"], row["omega_high"]) for row in rows if row["mu"] == m]
        if m not in known or any(abs(o - edge) < 1e-6 for tongue in tongues for edge in tongue):
            continue
        assert ((point["stability"]["stable"] is False)
                == any(low < o < high for low, high in tongues)), (m, o, point)
        checked += 1
    assert checked > 0.99 * len(known) * len(omega)
