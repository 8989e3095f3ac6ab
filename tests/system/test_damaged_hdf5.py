"""Damaged HDF5 files: none ends modalctl by a signal, keeps it, or is read as other numbers."""
# Tests as well: apart.c h5_numbers.c hdf5.c scene_file.c
import json
import resource
import subprocess

import h5py
import numpy as np
import pytest
from conftest import BUILD, environment
from sanitized import SANITIZED

DT = 0.01
Y = (np.arange(2 ** 14) % 977).astype("i4")[:, None]
PACKED = {"scale-offset": {"scaleoffset": 0}, "szip": {"compression": "szip"},
          "shuffle": {"shuffle": True}, "gzip": {"compression": 1}}


def export(path, tmp_path, before=None):
    """What modalctl ended with and said; no signal, whatever PATH is."""
    run = subprocess.run([BUILD / "bin" / "modalctl", "--json", "export", path, "-O",
                          tmp_path / "out.h5"], capture_output=True, env=environment(), text=True,
                         preexec_fn=before)
    assert run.returncode in (0, 1, 2), run
    return json.loads(run.stdout).get("error")


def with_last_bytes_lost(path, **options):
    with h5py.File(path, "w") as file:
        file.create_dataset("signals", data=Y, chunks=Y.shape, **options).attrs["dt"] = DT
    with h5py.File(path, "r+") as file:
        signals = file["signals"].id
        mask, packed = signals.read_direct_chunk((0, 0))
        if "szip" in options.values():      # which says itself what it unpacks to
            packed = (int.from_bytes(packed[:4], "little") // 2).to_bytes(4, "little") + packed[4:]
        else:
            packed = packed[:len(packed) - 1000]
        signals.write_direct_chunk((0, 0), packed, filter_mask=mask)


@pytest.mark.parametrize("options", PACKED.values(), ids=PACKED)
def test_a_chunk_shorter_than_it_says_is_refused(options, tmp_path):
    """libhdf5 1.10 took what lay behind it in memory for its numbers, or ended by SIGSEGV."""
    with_last_bytes_lost(tmp_path / "x.h5", **options)
    error = export(tmp_path / "x.h5", tmp_path)
    assert error is not None and error["field"] == "signals", error
    assert "damaged" in error["message"]


def test_a_filter_that_is_not_built_in_is_named(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("signals", data=Y[:1000], compression="lzf").attrs["dt"] = DT
    assert "filter 32000 (lzf)" in export(tmp_path / "x.h5", tmp_path)["message"]


def test_times_and_matrices_in_other_files_are_refused_as_signals_are(ctl, tmp_path):
    """They were read, from files that only their reader may read."""
    (tmp_path / "secret").write_bytes(np.linspace(0, 1.99, 200).tobytes())
    apart = {"external": [(str(tmp_path / "secret"), 0, 1600)]}
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["signals"] = np.sin(np.arange(200.0))[:, None]
        file.create_dataset("time", (200,), "f8", **apart)
    error = export(tmp_path / "x.h5", tmp_path)
    assert error["field"] == "time" and "in other files" in error["message"]
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file["M"] = np.eye(2)
        file.create_dataset("K", (2, 2), "f8", **apart)
    scene = tmp_path / "scene.json"
    scene.write_text('{"structure": {"type": "matrices", "file": "m.h5"}}')
    error = ctl("--local", "floquet", scene).document["error"]
    assert error["field"] == "structure.file" and "in other files" in error["message"]


def test_an_empty_dataset_is_no_number(tmp_path):
    """What lay in memory was taken for the step."""
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["signals"] = np.sin(np.arange(200.0))[:, None]
        file["dt"] = h5py.Empty("f8")
    error = export(tmp_path / "x.h5", tmp_path)
    assert error["field"] == "dt" and "`dt` is" not in error["message"], error


def numbers(tmp_path):
    with h5py.File(tmp_path / "out.h5") as file:
        return file["signals"][()]


def test_numbers_in_many_chunks_are_read(tmp_path):
    """libhdf5 1.10 takes 4 kB beside each that one call reads: those of 70,000 were refused."""
    x = (np.arange(100000) % 32749).astype("i2")[:, None]
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_chunk((1, 1))
    how.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    with h5py.File(tmp_path / "x.h5", "w", libver="latest") as file:
        h5py.h5d.create(file.id, b"signals", h5py.h5t.NATIVE_INT16,
                        h5py.h5s.create_simple(x.shape), how)
        file["signals"].attrs["dt"] = DT
        begin = file["signals"].id.get_chunk_info(0).byte_offset
        ends = file["signals"].id.get_chunk_info(len(x) - 1).byte_offset + 2
    assert ends - begin == x.nbytes         # one behind the other
    with open(tmp_path / "x.h5", "r+b") as file:
        file.seek(begin)
        file.write(x.tobytes())
    assert export(tmp_path / "x.h5", tmp_path) is None
    assert (numbers(tmp_path) == x).all()


@pytest.mark.parametrize("chunks", [(2, 3), (2, 30)])
def test_numbers_are_where_they_were_whatever_the_chunks(chunks, tmp_path):
    x = np.arange(61 * 301.0).reshape(61, 301)
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("signals", data=x, chunks=chunks).attrs["dt"] = DT
    assert export(tmp_path / "x.h5", tmp_path) is None
    assert (numbers(tmp_path) == x).all()


@pytest.mark.skipif(SANITIZED, reason="whose memory has no limits")
def test_a_chunk_that_memory_does_not_hold_is_not_called_damaged(tmp_path):
    size = 1 << 25
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("signals", data=Y[:1000], dtype="i1", chunks=(size, 1),
                            maxshape=(None, 1), compression=1).attrs["dt"] = DT
    error = export(tmp_path / "x.h5", tmp_path,
                   lambda: resource.setrlimit(resource.RLIMIT_DATA, (size, size)))
    assert error["code"] == "no_memory" and "damaged" not in error["message"], error
