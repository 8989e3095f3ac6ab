"""Structures of many entries: what a file of matrices or scipy gives is the same job here and in
the daemon, whose 16 MiB of JSON would not hold it.
"""
# Tests as well: scene_arrays.c scene_file.c matrix_market.c serve.c
import hashlib
import json
import struct

import h5py
import modald
import numpy as np
import pytest
from wire import Daemon, crc32c

sparse = pytest.importorskip("scipy.sparse")
mmwrite = pytest.importorskip("scipy.io").mmwrite

DOFS, REACH = 10000, 20
CONTACTS = ("x37", "x7345")
DOCUMENTS = ("converged", "harmonics", "residual", "total_error", "iterations", "diagnostics")


@pytest.fixture(scope="module")
def structure():
    """Each dof joined to the twenty on either side by springs of 17 digits: 820,000 entries."""
    random = np.random.RandomState(3)
    K = sparse.diags(np.full(DOFS, 0.5))
    for step in range(1, REACH + 1):
        k = (1 + random.rand(DOFS - step)) / step**2
        ends = np.concatenate([k, np.zeros(step)]) + np.concatenate([np.zeros(step), k])
        K = K + sparse.diags([ends, -k, -k], [0, step, -step])
    M = sparse.diags(1 + 0.3 * random.rand(DOFS)).tocsr()
    K = K.tocsr()
    return {"M": M, "K": K, "C": (0.02 * K + 0.05 * M).tocsr()}


def scene_of(structure):
    return {"structure": {"type": "matrices", **structure}, "omega": 0.9,
            "effects": [{"type": "cubic_spring", "dof": dof, "coefficient": 0.4}
                        for dof in CONTACTS],
            "excitation": [{"dof": "x100", "k": 1, "cos": 3.0}], "sensors": [{"dof": "x9999"}],
            "steady": {"harmonics": 3, "stability": False}}


def written(folder, structure, form):
    """The scene's path, with matrices in files of FORM beside it."""
    names = {name: f"{name}.mtx" for name in structure}
    if form == "hdf5":
        names = {"file": "matrices.h5"}
        with h5py.File(folder / "matrices.h5", "w") as file:
            for name, matrix in structure.items():
                for part in ("data", "indices", "indptr"):
                    file.create_dataset(f"{name}/{part}", data=getattr(matrix, part))
    else:
        for name, matrix in structure.items():
            mmwrite(folder / names[name], matrix.tocoo(), precision=17, symmetry="symmetric")
    path = folder / "scene.json"
    path.write_text(json.dumps(scene_of(names)))
    return path


@pytest.fixture(scope="module")
def here(structure, ctl, tmp_path_factory):
    said = ctl("steady", written(tmp_path_factory.mktemp("here"), structure, "mtx"))
    assert said.status == 0, said.document
    return said.document


def same(a, b):
    assert [a.get(name) for name in DOCUMENTS] == [b.get(name) for name in DOCUMENTS]
    assert a["plan"]["hash"] == b["plan"]["hash"]


@pytest.mark.parametrize("form", ["mtx", "hdf5"])
def test_a_structure_of_more_than_16_mib_of_json_has_one_answer_here_and_in_the_daemon(
        form, structure, here, daemon, ctl, tmp_path):
    path = written(tmp_path, structure, form)
    there = ctl("steady", path, server=daemon)
    assert there.status == 0 and there.document["converged"], there.document
    same(there.document, here)
    own = ctl("steady", path).document["provenance"]["input_sha256"]
    assert own == there.document["provenance"]["input_sha256"]


def test_scipys_matrices_in_a_scene_are_those_of_files(structure, here, client):
    same(client.steady(scene_of(structure)), here)


def test_of_many_dofs_those_of_laws_loads_and_sensors_are_reported_by_the_daemon_too(
        structure, here, daemon, ctl, client):
    reported = {"x37", "x7345", "x100", "x9999"}
    assert {row["dof"] for row in here["harmonics"]} == reported
    asked = client.steady(scene_of(structure), {"dofs": "x5"})
    assert [row["dof"] for row in asked["harmonics"]] == ["x5"]


def test_another_job_on_the_structure_brings_nothing_again(structure, daemon, ctl, tmp_path):
    path = written(tmp_path, structure, "mtx")
    assert ctl("steady", path, "-o", "harmonics=2", server=daemon).status == 0
    before = ctl("stats", server=daemon).document["spool"]
    assert ctl("steady", path, "-o", "harmonics=1", server=daemon).status == 0
    sweep = {"verb": "steady", "scene": json.loads(path.read_text()),
             "grid": [{"path": "excitation[0].cos", "values": [1.0, 2.0, 3.0]}]}
    (tmp_path / "sweep.json").write_text(json.dumps(sweep))
    after = ctl("stats", server=daemon).document["spool"]
    assert before["bytes"] > 8 << 20 > 100 * (after["bytes"] - before["bytes"]), (before, after)
    swept = ctl("sweep", tmp_path / "sweep.json", "--wait", server=daemon).document
    assert [point["converged"] for point in swept["points"]] == [True] * 3
    held = ctl("stats", server=daemon).document["spool"]["bytes"] - after["bytes"]
    assert held < 2 * after["bytes"], "the shares of a sweep are jobs on one input"


@pytest.mark.parametrize("path, value", [("effects[0].coefficient", 0.7),
                                         ("excitation[0].cos", 4.0)])
def test_a_point_of_a_sweep_over_laws_or_loads_is_what_its_scene_has_alone(
        path, value, structure, client):
    scene = scene_of(structure)
    swept = client.steady(scene, {"sweep": f"{path}={value - 0.5}:{value}:3"})["points"]
    section, key = path.split("[0].")
    scene[section][0][key] = value
    alone = client.steady(scene)
    assert swept[-1]["value"] == value and swept[-1]["converged"] and alone["converged"]
    for found, expected in zip(swept[-1]["harmonics"], alone["harmonics"]):
        for part in ("re", "im"):
            assert np.allclose(found[part], expected[part], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("triangle", ["lower", "upper", "both"])
def test_matrices_of_calculix_are_those_of_matrix_market(triangle, ctl, tmp_path):
    K = sparse.csr_matrix(np.array([[5.0, -2, 0], [-2, 6, -1.5], [0, -1.5, 4]]))
    M = sparse.diags([1.0, 2.0, 1.5])
    part = {"lower": sparse.tril, "upper": sparse.triu, "both": sparse.coo_matrix}[triangle]
    for name, matrix in (("K.sti", K), ("M.mas", M)):
        rows = part(matrix).tocoo()
        (tmp_path / name).write_text("".join(f"  {i + 1} {j + 1} {v:.15e}\n" for i, j, v in
                                             zip(rows.row, rows.col, rows.data)))
        mmwrite(tmp_path / f"{name[0]}.mtx", matrix.tocoo(), precision=17)
    found = []
    for files in ({"M": "M.mas", "K": "K.sti"}, {"M": "M.mtx", "K": "K.mtx"}):
        (tmp_path / "scene.json").write_text(json.dumps({"structure": {"type": "matrices",
                                                                       **files}}))
        found.append(ctl("floquet", tmp_path / "scene.json").document["exponents"])
    exact = np.sqrt(np.linalg.eigvals(np.linalg.solve(M.toarray(), K.toarray())).real)
    assert found[0] == found[1]
    assert np.allclose(sorted(im for _, im in found[0] if im > 0), sorted(exact), rtol=1e-12)


@pytest.mark.parametrize("text, said", [
    ("", "has 0 rows"),
    ("1 1 2\n3 3 1\n", "row 3 in 2 lines; it is cut short"),
    ("1 1 2\n2 2\n", "line 2: \"row column value\" is wanted"),
    ("1 1 2\n0 2 1\n", "line 2: \"row column value\" is wanted"),
    ("1 1 2\n1.5 1 1\n", "line 2: (1.5, 1) is outside"),
    ("1 1 nan\n", "line 1: \"row column value\" is wanted"),
])
def test_a_file_of_calculix_that_is_none_is_refused_with_its_line(text, said, ctl, tmp_path):
    (tmp_path / "K.sti").write_text(text)
    (tmp_path / "scene.json").write_text(json.dumps({"structure": {
        "type": "matrices", "M": [[1]], "K": "K.sti"}}))
    answer = ctl("floquet", tmp_path / "scene.json")
    assert answer.status == 2 and answer.document["error"]["field"] == "structure.K"
    assert said in answer.document["error"]["message"]


# -- what is no matrix ----------------------------------------------------------------------------

POINTERS, COLUMNS, VALUES = (0, 1, 2), (0, 1), (2.0, 3.0)


def arrays(pointers=POINTERS, columns=COLUMNS, values=VALUES):
    return struct.pack("<3I2I2d", *pointers, *columns, *values)


def small(behind, **place):
    """A scene whose K stands behind its text, as PLACE says."""
    K = {"shape": [2, 2], "entries": 2, "offset": 0, **place}
    text = json.dumps({"structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "K": K},
                       "omega": 1.0, "excitation": [{"dof": "x1", "k": 1, "cos": 1.0}]})
    return text.encode() + (b"" if behind is None else b"\0" + behind)


BAD = [
    (small(None), "bad_input", "0 bytes stand behind the scene's text"),
    (small(b""), "bad_input", "0 bytes stand behind"),
    (small(arrays()[:-1]), "bad_input", "take 36 bytes; 35 bytes stand"),
    (small(arrays(), offset=1), "bad_input", "at offset 1"),
    (small(arrays(), offset=2**53), "bad_input", "at offset 9007199254740992"),
    (small(arrays(), offset=-1), "bad_input", "offset"),
    (small(arrays(), entries=1), "bad_input", "row_pointers go from 0 to 2"),
    (small(arrays(), entries=10**8), "bad_input", "take 1200000012 bytes"),
    (small(arrays(), entries=10**8 + 1), "too_large", "at most 100000000 entries"),
    (small(arrays(), shape=[10**6 + 1, 10**6 + 1]), "too_large", "1 to 1000000 rows"),
    (small(arrays() * 2, shape=[2, 3]), "bad_input", "square"),
    (small(arrays(), shape=[2]), "bad_input", "shape"),
    (small(arrays(), rows=2), "bad_input", "rows"),
    (small(arrays(pointers=(1, 1, 2))), "bad_input", "row_pointers go from 1 to 2"),
    (small(arrays(pointers=(0, 3, 2))), "bad_input", "row 0 has its entries from 0 to 3"),
    (small(arrays(columns=(0, 2))), "bad_input", "column 2; accepted: 0 to 1"),
    (small(arrays(columns=(0, 2**32 - 1))), "bad_input", "column 4294967295"),
    (small(arrays(values=(2.0, float("nan")))), "bad_input", "entry (1, 1) is not finite"),
    (small(arrays(values=(float("inf"), 3.0))), "bad_input", "entry (0, 0) is not finite"),
]


def answered(client, scene, **more):
    job = client.ask("SUBMIT", [scene], kind="steady", input={"content": "scene"}, **more)
    return client.ask("WAIT", job=job["job"], timeout_s=300)


@pytest.fixture(scope="module")
def own():
    with Daemon(workers=1) as made:
        yield made


def test_the_good_one_of_them_is_answered(own):
    assert answered(own.client(), small(arrays()))["state"] == "done"


@pytest.mark.parametrize("scene, code, said", BAD, ids=[said for _, _, said in BAD])
def test_arrays_that_are_no_matrix_fail_their_job_by_name_and_end_no_worker(own, scene, code, said):
    client = own.client()
    doc = answered(client, scene)
    assert doc["state"] == "failed" and doc["attempts"] == 1, doc
    assert doc["error"]["code"] == code and doc["error"]["field"].startswith("structure.K")
    assert said in doc["error"]["message"], doc
    assert client.ask("STATS")["workers"]["deaths"] == 0
    client.close()


def test_a_text_over_its_limit_is_refused_with_what_would_be_taken(daemon, ctl, tmp_path):
    scene = {"units": "x" * 16777216, "structure": {"type": "chain", "masses": [1],
                                                    "springs": [1, 0]}}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    said = ctl("floquet", tmp_path / "scene.json", server=daemon).document["error"]
    assert (said["code"], said["field"]) == ("too_large", "bytes")
    assert "at most 16777216, and matrices of more as arrays" in said["message"]


def test_a_text_that_was_called_arrays_fails_its_job(own):
    client, chunk, count = own.client(), b" " * 262144, 65
    upload = client.ask("UPLOAD", op="begin", content="scene", bytes=len(chunk),
                        arrays=(count - 1) * len(chunk))["upload"]
    crc = crc32c(chunk)
    for i in range(count):
        assert client.ask("UPLOAD", [chunk], op="chunk", upload=upload, offset=i * len(chunk),
                          crc32c=crc).ok
    whole = b"modald/scene/1\0" + struct.pack("<Q", count * len(chunk)) + count * chunk
    assert client.ask("UPLOAD", op="seal", upload=upload,
                      sha256=hashlib.sha256(whole).hexdigest()).ok
    job = client.ask("SUBMIT", kind="steady", input={"upload": upload})
    doc = client.ask("WAIT", job=job["job"], timeout_s=300)
    assert (doc["error"]["code"], doc["error"]["field"]) == ("too_large", "scene"), doc
    client.close()


def test_an_input_over_input_bytes_is_refused_before_anything_is_sent(own_daemon, structure, ctl,
                                                                      tmp_path):
    daemon = own_daemon(workers=1, config=["input_bytes = 1000000"])
    said = ctl("steady", written(tmp_path, structure, "mtx"), server=daemon).document["error"]
    assert (said["code"], said["field"]) == ("too_large", "bytes")
    assert ctl("stats", server=daemon).document["spool"]["uploads"] == 0


def test_an_entry_that_is_no_real_number_never_leaves_python(structure, client):
    for value, kind in ((float("nan"), float), (1j, complex)):
        M = sparse.eye(3, dtype=kind, format="csr") * value
        with pytest.raises(modald.Error) as caught:
            client.steady({"structure": {"type": "matrices", "M": M, "K": M}})
        assert (caught.value.code, caught.value.field) == ("bad_input", "scene")
