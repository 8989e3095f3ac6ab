"""The Python client as its users have it: jobs as futures, results as arrays, numpy in and out."""
import asyncio
import concurrent.futures
import dataclasses
import inspect
import json
import os
import pathlib
import pickle
import pkgutil
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
import xml.etree.ElementTree

import numpy as np
import pytest

import modald
import sanitized
import test_files
from conftest import PATIENCE, SLOW, TOP, decay, environment

in_python = pytest.mark.skipif(sanitized.SANITIZED,
                               reason="Python is no program of ours to have a sanitizer's runtime")

DAMPER = {"structure": {"type": "matrices", "M": [[1]], "C": [[0.02]], "K": [[0.75]],
                        "dofs": ["x"]},
          "effects": [{"type": "friction", "dof": "x", "stiffness": 0.25, "limit": 0.25}],
          "omega": 0.25, "excitation": [{"dof": "x", "k": 2, "sin": 0.75}]}


def batch(k=0):
    """One mode of 2.3 + 0.01 k Hz, half a percent of damping."""
    return modald.Batch(decay(modes=((2.3 + 0.01 * k, 0.005, 1.0),)), 0.05)


def submitted(client, name, many=8, **options):
    return [client.submit("identify", batch(k), {"rank.fixed": 2, **options}, key=f"{name}-{k}")
            for k in range(many)]


@pytest.fixture(scope="module")
def slow():
    return modald.Batch(np.random.default_rng(7).standard_normal((8000, 1)), 0.05)


# -- jobs as futures ------------------------------------------------------------------------------

def test_jobs_are_futures_for_whoever_waits_for_futures(client):
    done, left = concurrent.futures.wait(submitted(client, "wait"), timeout=PATIENCE)
    assert not left and len(done) == 8

    async def gathered():
        return await asyncio.wait_for(asyncio.gather(*map(
            asyncio.wrap_future, submitted(client, "asyncio"))), PATIENCE)
    for k, result in enumerate(asyncio.run(gathered())):
        assert result.frequency_hz == pytest.approx([2.3 + 0.01 * k], rel=1e-9)
    called = threading.Event()
    job = submitted(client, "callback", 1)[0]
    job.add_done_callback(lambda ended: ended is job and called.set())
    assert called.wait(PATIENCE) and job.done() and job.exception() is None


def test_as_completed_gives_what_ends_first_first(own_daemon, slow):
    daemon = own_daemon(workers=2)
    with daemon.client() as client:
        long = client.submit("identify", slow, SLOW, key="long")
        short = client.submit("identify", batch(), {"rank.fixed": 2}, key="short")
        ended = modald.as_completed([long, short], PATIENCE)
        assert next(ended) is short and not long.done()
        assert long.cancel() and next(ended) is long and long.cancelled()
        with pytest.raises(modald.Error) as caught:
            long.result()
        assert caught.value.code == "cancelled" and not short.cancel()


def test_a_job_that_fails_or_does_not_end_in_time_is_an_error_of_ours(own_daemon, slow):
    with own_daemon(workers=1).client() as client:
        bad = client.submit("identify", modald.Batch(np.ones((100, 1)), 0.1), key="constant")
        assert next(modald.as_completed([bad], PATIENCE)) is bad
        with pytest.raises(modald.Error) as caught:
            bad.result()
        assert caught.value.code == "bad_input" and bad.exception().field == "signals"
        long = client.submit("identify", slow, SLOW, key="long")
        for call in (lambda: long.result(0.01), lambda: list(modald.as_completed([long], 0.01))):
            with pytest.raises(modald.Error) as caught:
                call()
            assert caught.value.code == "timeout" and not long.done()
        long.cancel()


def test_a_future_whose_client_is_closed_ends_with_an_error(own_daemon, slow):
    daemon = own_daemon(workers=1)
    client = daemon.client()
    long = client.submit("identify", slow, SLOW, key="long")
    heard = threading.Event()
    long.add_done_callback(lambda job: heard.set())
    client.close()
    assert heard.wait(PATIENCE) and long.done()
    daemon.kill()                                             # the job would be waited for


def test_a_watched_job_is_told_of_over_a_restart_of_the_daemon(own_daemon, slow):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        jobs = [client.submit("identify", slow, SLOW, key="first"), *submitted(client, "then", 3)]
        assert not any(job.done() for job in jobs)
        daemon.kill()
        daemon.start()
        jobs[0].cancel()
        assert set(modald.as_completed(jobs, PATIENCE)) == set(jobs)
        assert [job.state for job in jobs] == ["cancelled", "done", "done", "done"]


def test_map_gives_results_in_the_order_of_its_batches(client):
    found = client.map(map(batch, range(30)), rank_fixed=2, timeout=PATIENCE)
    assert np.allclose([result.frequency_hz[0] for result in found],
                       2.3 + 0.01 * np.arange(30), rtol=1e-9)


def test_map_that_fails_cancels_what_nobody_will_fetch(own_daemon, slow):
    with own_daemon(workers=1).client() as client:
        with pytest.raises(modald.Error) as caught:
            list(client.map([modald.Batch(np.ones((100, 1)), 0.1), slow, slow],
                            rank_fixed=300, rows=3900, columns=4000))
        assert caught.value.field == "signals"
        assert [job["state"] for job in client.list()].count("cancelled") == 2


def test_progress_is_tqdm_s_where_it_is_and_a_line_where_it_is_not(client, monkeypatch, capsys):
    bars = []

    def tqdm(items, total):
        bars.append(total)
        return items
    whole, part = types.ModuleType("tqdm"), types.ModuleType("tqdm.auto")
    part.tqdm = tqdm
    monkeypatch.setitem(sys.modules, "tqdm", whole)
    monkeypatch.setitem(sys.modules, "tqdm.auto", part)
    assert len(list(client.map([batch()] * 3, progress=True))) == 3 and bars == [3]
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    assert len(list(modald.as_completed(submitted(client, "bar", 2), progress=True))) == 2
    assert capsys.readouterr().err.endswith("modald: 2 of 2\n")


# -- results --------------------------------------------------------------------------------------

def test_a_result_is_its_document_and_the_same_as_arrays(client):
    result = client.identify(decay(), 0.05, {"rank.fixed": 4, "shapes": True})
    assert json.loads(json.dumps(result)) == result and isinstance(result, dict)
    assert np.allclose(np.sort(result.frequency_hz), [1.0, 2.3], rtol=1e-9)
    assert np.allclose(np.sort(result.damping_ratio), [0.005, 0.01], rtol=1e-6)
    assert np.allclose(abs(result.exponent) / (2 * np.pi), result.frequency_hz)
    assert np.allclose(np.exp(result.exponent * 0.05), result.multiplier)
    assert result.shapes.shape == (2, 2)
    for i, f in enumerate(result.frequency_hz):         # channels of decay() are 0.7 f rad apart
        assert abs(np.angle(result.shapes[i, 1] / result.shapes[i, 0])) == pytest.approx(
            0.7 * f, abs=1e-4)
    assert result.std_frequency_hz.shape == result.std_damping_ratio.shape == (2,)
    with pytest.raises(modald.Error) as caught:
        client.identify(decay(), 0.05, {"rank.fixed": 4}).shapes
    assert caught.value.field == "shapes"
    noise = modald.Result({"kind": "identify", "modes": [{"frequency_hz": 1.0, "std": None}]})
    assert np.isnan(noise.std_frequency_hz[0]) and np.isnan(noise.damping_ratio[0])


@pytest.mark.parametrize("kind", ["identify", "steady", "curve", "floquet", "tradeoff"])
def test_no_picture_of_what_is_no_result_and_of_no_dof_that_is_not_there(kind):
    for members in ({}, {"modes": 1, "harmonics": 1, "points": [{}], "rungs": [7],
                         "multipliers": [1]}):
        with pytest.raises(modald.Error) as caught:
            modald.Result({"kind": kind, **members}).plot()
        assert caught.value.code == "bad_frame"
    shown = {"dof": "x1", "k": [1], "re": [1.0], "im": [0.0]}
    steady = modald.Result({"kind": "steady", "harmonics": [shown]})
    with pytest.raises(modald.Error) as caught:
        steady.plot(dof=1)
    assert (caught.value.code, caught.value.field) == ("bad_input", "dof")


def results(client):
    yield "identify", client.identify(decay(), 0.05, {"rank.fixed": 4})
    yield "steady", client.steady(DAMPER)
    yield "curve", client.steady(DAMPER, {"sweep": "omega=0.2:0.3:3"})
    chain = {"structure": {"type": "chain", "masses": [1, 1], "springs": [4, 2, 0]}, "omega": 3.0}
    yield "floquet", client.floquet({**chain, "effects": [
        {"type": "parametric_stiffness", "dof": "x1", "k": 1, "stiffness": 0.2}]})
    yield "floquet", client.floquet(chain)
    yield "tradeoff", client.run("tradeoff", batch(), {"of": "identify"})


def test_every_kind_of_result_has_its_table_and_its_pictures(client, monkeypatch):
    import matplotlib
    matplotlib.use("agg")
    import matplotlib.pyplot as plt
    frames = types.ModuleType("pandas")
    frames.DataFrame = list
    monkeypatch.setitem(sys.modules, "pandas", frames)
    seen = []
    for kind, result in results(client):
        assert result["kind"] == kind
        page = xml.etree.ElementTree.fromstring(result._repr_html_())
        assert page.findall(".//{http://www.w3.org/2000/svg}circle") and result.rows()
        assert len(page.findall(".//tr")) == min(len(result.rows()), 50) + 1
        assert result.to_pandas() == result.rows()
        plt.close(result.plot())
        seen.append(len(result.rows()))
    assert seen[0] == 2 and seen[2] == 3 and seen[3:5] == [4, 4]


def test_the_picture_of_modes_has_them_where_their_numbers_say(client):
    result = client.identify(decay(), 0.05, {"rank.fixed": 4})
    dots = [(float(c.get("cx")), float(c.get("cy"))) for c in xml.etree.ElementTree.fromstring(
        result.svg()).iter("{http://www.w3.org/2000/svg}circle")]
    order = np.argsort(result.frequency_hz)
    assert list(order) == list(np.argsort([x for x, _ in dots]))
    assert list(np.argsort(result.damping_ratio)) == list(np.argsort([-y for _, y in dots]))


def test_what_is_not_installed_is_named(client, monkeypatch):
    result = client.identify(decay(), 0.05, {"rank.fixed": 4})
    for module, call in (("pandas", result.to_pandas), ("matplotlib", result.plot),
                         ("h5py", lambda: modald.Batch.read("x.h5"))):
        monkeypatch.setitem(sys.modules, module, None)
        monkeypatch.delitem(sys.modules, "modald.plots", raising=False)
        monkeypatch.delattr(modald, "plots", raising=False)
        with pytest.raises(modald.Error) as caught:
            call()
        assert f"python3-{module}" in str(caught.value)


# -- numpy and scipy in ---------------------------------------------------------------------------

def chain(n):
    scipy = pytest.importorskip("scipy.sparse")
    K = scipy.diags([-900 * np.ones(n - 1), 1800 * np.ones(n), -900 * np.ones(n - 1)],
                    [-1, 0, 1]).tocsr()
    return scipy.diags(1.5 + 0.01 * np.arange(n)).tocsr(), K


def frequencies(exponents):
    return np.unique(np.round(abs(exponents), 9))


def test_arrays_and_sparse_matrices_stand_for_lists(client):
    M, K = chain(6)
    exact = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M.toarray(), K.toarray())).real))
    for structure in (modald.scene.matrices(M, K), modald.scene.matrices(M.toarray(), K.tocoo()),
                      {"type": "matrices", "M": M.toarray().tolist(), "K": K.toarray()}):
        found = client.floquet({"structure": structure, "omega": np.float64(1.0)})
        assert np.allclose(frequencies(found.exponent), exact, rtol=1e-8)
    result = client.identify(decay(), 0.05, {"rank.fixed": np.int32(4),
                                             "window": np.array([0.0, 10.0])})
    assert result["provenance"]["options"]["window"] == [0, 10]


@pytest.mark.parametrize("call, field", [
    (lambda c: c.steady({"structure": {"M": np.array([[1j]])}}), "scene"),
    (lambda c: c.steady({"structure": {"M": [[float("nan")]]}}), "scene"),
    (lambda c: c.steady({"omega": object()}), "scene"),
    (lambda c: c.steady(7), "input"),
    (lambda c: c.submit("identify", decay()), "input"),
    (lambda c: c.identify(decay(), 0.05, {"rank.fixed": 1j}), "header"),
    (lambda c: c.identify("signals", 0.05), "signals"),
    (lambda c: c.identify([[1.0], [1.0, 2.0]], 0.05), "signals"),
    (lambda c: c.identify("plain.csv"), "signals"),
    (lambda c: c.identify(pathlib.Path("plain.csv"), 0.05), "signals"),
    (lambda c: c.identify(np.ones(100), 0.05, shapes=True), "shapes"),
    (lambda c: c.steady(DAMPER, harmonics=3), "harmonics"),
    (lambda c: c.sweep({"verb": "steady", "scene": DAMPER}), "grid"),
    (lambda c: modald.scene.matrices(np.eye(2), np.eye(3)), "K"),
    (lambda c: modald.scene.matrices(np.eye(2), [["a", "b"], [1, 2]]), "K"),
    (lambda c: modald.scene.craig_bampton(np.eye(3), np.eye(3), ["y"], 1), "keep"),
    (lambda c: modald.scene.craig_bampton(np.eye(3), np.eye(3), [0, 0], 1), "keep"),
    (lambda c: modald.scene.craig_bampton(np.eye(3), np.eye(3), [0], 3), "modes"),
    (lambda c: modald.scene.craig_bampton(-np.eye(3), np.eye(3), [0], 1), "M"),
    (lambda c: modald.scene.matrix_market("/nothing.mtx"), "file"),
    (lambda c: modald.scene.calculix("/nothing.sti", "/nothing.mas"), "file"),
    (lambda c: modald.read("/nothing.csv"), "file"),
])
def test_every_failure_is_an_error_that_names_a_field(client, call, field):
    with pytest.raises(modald.Error) as caught:
        call(client)
    assert caught.value.field == field and caught.value.code == "bad_input"
    copy = pickle.loads(pickle.dumps(caught.value))
    assert str(copy) == str(caught.value) and copy.field == field


# -- structures -----------------------------------------------------------------------------------

@pytest.mark.parametrize("form", ["sparse", "dense"])
def test_craig_bampton_is_exact_in_statics_and_close_in_its_lowest_modes(form, client):
    """With all fixed modes it is a change of coordinates; each it lacks moves no frequency down."""
    M, K = chain(40)
    if form == "dense":
        M, K = M.toarray(), K.toarray()
    dense = [np.asarray(a.todense()) if form == "sparse" else a for a in (M, K)]
    exact = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(*dense)).real))
    load = np.zeros(40)
    load[[9, 39]] = 1.0, -2.0
    for modes in (0, 8, 38):
        small = modald.scene.craig_bampton(M, K, keep=[9, "x40"], modes=modes)
        m, k = small.structure["M"], small.structure["K"]
        assert small.dofs == ["x10", "x40"] + [f"q{i + 1}" for i in range(modes)]
        still = small.basis @ np.linalg.solve(k, small.basis.T @ load)
        assert np.allclose(still, np.linalg.solve(dense[1], load), rtol=1e-9)
        found = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(m, k)).real))
        assert (found >= exact[:len(found)] * (1 - 1e-10)).all()
        if modes == 38:
            assert np.allclose(found, exact, rtol=1e-9)
        if modes == 8:
            assert np.allclose(found[:4], exact[:4], rtol=1e-3)
            served = client.floquet({"structure": small.structure, "omega": 1.0})
            assert np.allclose(frequencies(served.exponent), found, rtol=1e-6)


def test_files_of_matrices_are_read_and_cut_ones_refused(tmp_path):
    io = pytest.importorskip("scipy.io")
    M, K = chain(7)
    io.mmwrite(tmp_path / "K.mtx", K, symmetry="symmetric")
    assert abs(modald.scene.matrix_market(tmp_path / "K.mtx") - K).max() == 0
    for name, matrix in (("b.sti", K), ("b.mas", M)):
        i, j = matrix.nonzero()
        (tmp_path / name).write_text("".join(
            f"{r + 1} {c + 1} {matrix[r, c]:.17e}\n" for r, c in zip(i, j) if r >= c))
    (tmp_path / "b.dof").write_text("".join(f"{n}.1\n" for n in range(3, 10)))
    stiffness, mass, names = modald.scene.calculix(*(tmp_path / f"b.{s}"
                                                     for s in ("sti", "mas", "dof")))
    assert abs(stiffness - K).max() == 0 == abs(mass - M).max() and names[0] == "3.1"
    text = (tmp_path / "b.sti").read_text()
    for cut, why in ((text[:len(text) // 2].rsplit(" ", 1)[0], "file"), ("", "file"),
                     ("900000 900000 1.0\n", "file"), ("1 1 nan\n", "file"),
                     ("1.5 1 2\n", "file")):
        (tmp_path / "cut.sti").write_text(cut)
        with pytest.raises(modald.Error) as caught:
            modald.scene.calculix(tmp_path / "cut.sti", tmp_path / "b.mas")
        assert caught.value.field == why
    (tmp_path / "cut.mtx").write_text((tmp_path / "K.mtx").read_text()[:90])
    with pytest.raises(modald.Error):
        modald.scene.matrix_market(tmp_path / "cut.mtx")


# -- files, estimator, a daemon of one's own -------------------------------------------------------

@pytest.mark.parametrize("kind", ["mat", "npz", "hdf5", "uff"])
def test_read_gives_the_samples_that_a_file_holds(kind, tmp_path):
    path = tmp_path / f"x.{kind}"
    getattr(test_files, kind)(path)
    found = modald.read(path)
    assert np.array_equal(found.signals, test_files.Y) and found.dt == test_files.DT


def test_read_says_what_modalctl_says(tmp_path):
    np.save(tmp_path / "x.npy", decay())
    with pytest.raises(modald.Error) as caught:
        modald.read(tmp_path / "x.npy")
    assert caught.value.field == "dt"
    assert np.array_equal(modald.read(tmp_path / "x.npy", dt=0.05, scale=2).signals, 2 * decay())


def test_an_estimator_has_the_shape_of_scikit_learn_s(client):
    made = modald.Identify(client, rank_fixed=4)
    again = type(made)(**made.get_params()).set_params(rank_fixed=2)
    assert made.fit(decay(), 0.05) is made and again.options == {"rank_fixed": 2}
    assert np.allclose(np.sort(made.frequency_hz_), [1.0, 2.3], rtol=1e-9)
    assert made.exponent_.shape == made.std_damping_ratio_.shape == (2,)
    assert made.result_["provenance"]["options"]["rank.fixed"] == 4


def test_no_option_of_identify_has_an_underscore():
    """For one stands for a dot in keyword arguments."""
    said = subprocess.run([modald.daemon.program("modalctl"), "identify", "--help"],
                          capture_output=True, text=True, check=True).stdout
    options = said.split("-o KEY=VALUE,")[1]
    assert "rank.fixed=" in options
    assert not [w for w in options.split() if "=" in w and "_" in w.split("=")[0]]


def test_a_local_daemon_is_there_and_gone_with_its_client():
    with modald.local(workers=1) as client:
        folder = pathlib.Path(client.folder)
        assert client.identify(decay(), 0.05, {"rank.fixed": 4})["modes"] and folder.exists()
        with pickle.loads(pickle.dumps(client)) as other:
            assert other.hello() and type(other) is modald.Client
    assert not folder.exists()


def test_a_local_daemon_ends_though_its_process_is_killed():
    script = "import modald; c = modald.local(workers=1); print(c.folder, flush=True); input()"
    run = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE,
                           stdout=subprocess.PIPE, text=True,
                           env=environment(PYTHONPATH=TOP / "clients" / "python"))
    folder = pathlib.Path(run.stdout.readline().strip())
    assert folder.exists()
    run.send_signal(signal.SIGKILL)
    run.communicate()
    end = time.monotonic() + PATIENCE
    while folder.exists():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_local_daemon_that_does_not_start_says_why(tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    broken = tmp_path / "bin" / "modald"
    broken.write_text("#!/bin/sh\necho no luck today >&2\nexit 7\n")
    broken.chmod(0o755)
    monkeypatch.setenv("MODALD_BUILD", str(tmp_path))
    with pytest.raises(modald.Error) as caught:
        modald.local()
    assert "no luck today" in str(caught.value)


# -- events and streams ---------------------------------------------------------------------------

def test_events_end_quietly_when_their_time_is_over(client):
    job = submitted(client, "events", 1)[0]
    job.result(PATIENCE)
    for event in client.events(start=1, job=job.id, timeout=PATIENCE):
        if event.header.get("state") == "done":
            break
    else:
        pytest.fail("no event of the job's end")
    assert list(client.events(job=job.id, timeout=3.0)) == []


@in_python
def test_the_verdict_stays_when_the_stream_is_closed(daemon, monkeypatch, tmp_path):
    monkeypatch.setenv("MODALD_URL", daemon.endpoint)
    monkeypatch.setenv("MODALD_SPILL", str(tmp_path))
    y = decay(400, 0.05)
    with modald.stream("kept", 2, 0.05, window=200, hop=100,
                       options={"rank.fixed": 4}) as s:
        s.push(y)
        end = time.monotonic() + PATIENCE
        while s.estimate is None or s.estimate.sample < 399:    # of the last window: none follows
            assert time.monotonic() < end
            time.sleep(0.01)
        was = s.verdict, s.estimate
    assert (s.verdict, s.estimate) == was and s.verdict == "stable" and s.report.pushed == 400
    assert s.estimate.frequency_hz == pytest.approx(2.3, rel=1e-3) or s.estimate.frequency_hz == (
        pytest.approx(1.0, rel=1e-3))


@in_python
def test_alarms_of_a_stream_are_rules_in_a_dictionary(daemon, client, monkeypatch, tmp_path):
    monkeypatch.setenv("MODALD_URL", daemon.endpoint)
    monkeypatch.setenv("MODALD_SPILL", str(tmp_path))
    monkeypatch.delenv("MODALD_ALARMS", raising=False)
    with modald.stream("ruled", 2, 0.05, window=200, hop=100,
                       alarms={"damping_below": 0.9}) as s:
        y, end = decay(600, 0.05), time.monotonic() + PATIENCE
        for k in range(0, 600, 100):
            s.push(y[k:k + 100])
            while k > 0 and (s.estimate is None or s.estimate.sample < k + 99):
                assert time.monotonic() < end
                time.sleep(0.01)
    told = (event.header for event in client.events(start=1, stream="ruled", timeout=PATIENCE))
    assert ("damping_below", "raised") in ((e["rule"], e["state"]) for e in told
                                           if e["event"] == "alarm")


# -- the manual and the types ---------------------------------------------------------------------

def members(thing, name):
    yield name, thing
    if inspect.isclass(thing):
        for key, value in vars(thing).items():
            called = callable(value) or isinstance(value, (property, classmethod, staticmethod))
            made = key == "__init__" and dataclasses.is_dataclass(thing)    # the class tells them
            if called and not made and (key in ("__init__", "__enter__") or key[0] != "_"):
                yield f"{name}.{key}", getattr(thing, key)


def test_help_has_no_empty_docstring():
    modules = [modald, *(__import__(f"modald.{m.name}", fromlist=["x"])
                         for m in pkgutil.iter_modules(modald.__path__))]
    assert len(modules) > 10
    empty = []
    for module in modules:
        for key, value in [("", module), *vars(module).items()]:
            ours = value is module or getattr(value, "__module__", None) == module.__name__
            if key.startswith("_") or not ours or not (callable(value) or value is module):
                continue
            empty += [name for name, member in members(value, f"{module.__name__}.{key}")
                      if not (getattr(member, "__doc__", None) or "").strip()]
    assert not empty


def test_the_types_are_those_that_mypy_finds():
    if shutil.which("mypy") is None:
        pytest.skip("mypy is not installed (Debian package mypy)")
    done = subprocess.run(["mypy", "--config-file", "pyproject.toml", "--cache-dir", os.devnull,
                           "modald"], cwd=TOP / "clients" / "python", capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stdout


# -- notebooks ------------------------------------------------------------------------------------

def notebook(name):
    """What NAME prints, its cells one after the other as a notebook runs them."""
    text = (TOP / "clients" / "python" / "examples" / f"{name}.py").read_text()
    assert len(text.split("# %%")) > 6
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True,
                          timeout=PATIENCE, env=environment(
                              PYTHONPATH=TOP / "clients" / "python"))
    assert done.returncode == 0, done.stderr
    return done.stdout


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.\d+(?:e-\d+)?", text)]


def test_the_notebook_of_a_recording_finds_what_it_made():
    lines = notebook("identify").splitlines()
    found = sorted(numbers(line) for line in lines if "damping ratio" in line)
    for (f, std, z, std_z), (exact, zeta) in zip(found, ((2.3, 0.005), (4.1, 0.002))):
        assert abs(f - exact) < 5 * std < 1e-2 and abs(z - zeta) < 5 * std_z < 1e-3
    assert len(found) == 2 and "stable" in lines
    assert numbers(lines[-1]) == pytest.approx([2.3, 4.1], rel=1e-2)


def test_the_notebook_of_a_contact_finds_that_it_stiffens():
    free, held = numbers(notebook("steady").splitlines()[-1])
    assert free == pytest.approx(1, abs=0.01) and held > free + 0.01


@in_python
def test_the_notebook_of_a_running_simulation_has_its_damping():
    verdict, window = notebook("live").splitlines()
    assert verdict.startswith("stable") and numbers(verdict) == pytest.approx([2.3, 0.005],
                                                                              rel=1e-3)
    assert numbers(window) == pytest.approx([2.3], rel=1e-3)


def test_the_notebook_of_a_service_counts_what_it_did():
    lines = notebook("lab").splitlines()
    assert lines[0] == "local admin" and lines[1] == "True"
    assert lines[2].startswith("20 ") and numbers(lines[2]) == pytest.approx(
        [np.hypot(w, 0.1) / (2 * np.pi) for w in (10, 29)], abs=1e-4)
    assert lines[3:] == ["done 20 queued 0 disk good", "failed 0"]


def test_the_text_of_an_error_commands_no_terminal():
    """A server wrote it."""
    error = modald.Error.of({"code": "busy", "message": "a\x1b[31m\x9b1m\u202eb\tü"})
    assert str(error) == "busy: a\\x1b[31m\\x9b1m\\u202eb\tü"
    assert error.message == "a\x1b[31m\x9b1m\u202eb\tü"
