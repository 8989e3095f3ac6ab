"""Files that others write, read by modalctl: MATLAB, NumPy, HDF5, universal files, OpenFAST, text.

Each is written here by somebody else's writer (scipy, numpy, h5py) or, where there is none in
Debian, from the published description of the format, and holds the same three decaying modes.
"""
import io
import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
from conftest import BUILD, PATIENCE, environment, write_batch

MODES = ((1.2, 0.010, 1.0), (3.7, 0.006, 0.6), (6.1, 0.012, 0.4))
DT, SAMPLES, NAMES = 0.01, 2000, ("tip", "mid", "root")
PARTS = range(100) if os.environ.get("MODALD_LONG") else (0, 1, 3, 9, 27, 50, 81, 99)
T = np.arange(SAMPLES) * DT
Y = np.column_stack([sum(a * np.exp(-z * 2 * np.pi * f * T)
                         * np.cos(2 * np.pi * f * np.sqrt(1 - z * z) * T + 0.7 * c * f)
                         for f, z, a in MODES) for c in range(3)])


# -- writers
# --------------------------------------------------------------------------------------------------

def mat(path, y=Y, compressed=False, **more):
    scipy.io.savemat(path, {"accel": y, "Fs": 1 / DT, "note": "hammer", **more},
                     do_compression=compressed)


def mat_big_endian(path, y=Y):
    """Version 5 with the other order of bytes: what scipy reads and nobody writes any more."""
    def element(kind, data):
        return struct.pack(">II", kind, len(data)) + data + bytes(-len(data) % 8)

    def matrix(name, x):
        x = np.atleast_2d(x)
        return element(14, element(6, struct.pack(">II", 6, 0))
                       + element(5, struct.pack(">ii", *x.shape)) + element(1, name)
                       + element(9, x.astype(">f8").tobytes("F")))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + b"\1\0MI" + matrix(b"accel", y)
                     + matrix(b"dt", DT))
    assert np.array_equal(scipy.io.loadmat(path)["accel"], y)


def mat_73(path, y=Y):
    """HDF5 behind 512 bytes, matrices turned, as MATLAB's save -v7.3."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, x, kind in (("accel", y, b"double"), ("time", T[:, None], b"double"),
                              ("note", np.frombuffer("hammer".encode("utf-16-le"), "<u2")[:, None],
                               b"char")):
            file.create_dataset(name,
                                data=np.atleast_2d(x).T).attrs["MATLAB_class"] = np.bytes_(kind)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def npy(path, y=Y):
    # savez and save put a suffix to a name
    with open(path, "wb") as file:
        np.save(file, y)


def npz(path, y=Y, save=np.savez, **more):
    with open(path, "wb") as file:
        save(file, accel=y, **{"dt": DT, "names": np.array(NAMES), **more})


def hdf5(path, y=Y):
    with h5py.File(path, "w") as file:
        file.create_dataset("run/accel", data=y)
        file.create_dataset("run/time", data=T)
        file.create_dataset("about", data=b"hammer")


def uff(path, y=Y, binary=True, wide=True, function=1, even=True, big=False, announced=None,
        time=("NONE", "NONE")):
    """Data set 151 and a 58 or 58b a channel; columns as in the description by the University of
    Cincinnati."""
    out = [b"    -1\n   151\nmodel\nnobody\n    -1\n"]
    order = ">" if big else "<"
    for c in range(y.shape[1]):
        x = y[:, c]
        form = 4 if wide else 2
        head = ["channel", "NONE", "22-Nov-26", "NONE", "NONE",
                f"{function:5d}{0:10d}{1:5d}{0:10d} {'NONE':10s}{c + 1:10d}{3:4d} "
                f"{'NONE':10s}{0:10d}{0:4d}",
                f"{form:10d}{announced or len(x):10d}{int(even):10d}"
                f"{0:13.5e}{DT if even else 0:13.5e}{0:13.5e}",
                *[f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}"
                  for kind, (label, unit) in zip((17, 12, 0, 0), (time, *[("NONE", "NONE")] * 3))]]
        if binary:
            own = np.dtype(order + ("f8" if wide else "f4"))
            data = (x.astype(own).tobytes() if even
                    else np.rec.fromarrays([T.astype(order + "f4"), x.astype(own)]).tobytes())
            first = (f"    58b{2 if big else 1:6d}{2:6d}{11:12d}{len(data):12d}"
                     f"{0:6d}{0:6d}{0:12d}{0:12d}")
            out.append(("    -1\n" + "\n".join([first, *head]) + "\n").encode() + data
                       + b"\n    -1\n")
        else:
            width, per = ("%20.12e", 4) if wide else ("%13.5e", 6)
            fields = [width % v for v in x]
            rows = ["".join(fields[k:k + per]) for k in range(0, len(x), per)]
            out.append(("\r\n".join(["    -1", "    58", *head, *rows, "    -1"])
                        + "\r\n").encode())
    path.write_bytes(b"".join(out))


def outb(path, y=Y, form=4, time="(s)"):
    """OpenFAST's binary output as NWTC_IO.f90 writes it; what it stores is returned."""
    width = 10 if form != 4 else 14
    names = "".join(n.ljust(width) for n in ("Time", *NAMES)).encode()
    units = "".join(u.ljust(width) for u in (time, "(m/s^2)", "(m/s^2)", "(m/s^2)")).encode()
    scale = (65535 / (y.max(0) - y.min(0))).astype("<f4")
    offset = (-32768 - scale.astype(float) * y.min(0)).astype("<f4")
    packed = np.clip(np.round(scale.astype(float) * y + offset), -32768, 32767).astype("<i2")
    head = struct.pack("<h", form) + (struct.pack("<h", width) if form
                                      == 4 else b"") + struct.pack("<ii", y.shape[1], len(y))
    head += struct.pack("<dd", 1e5, 0) if form == 1 else struct.pack("<dd", 0, DT)
    head += b"" if form == 3 else scale.tobytes() + offset.tobytes()
    head += struct.pack("<i", 6) + b"a test" + names + units
    head += np.round(T * 1e5).astype("<i4").tobytes() if form == 1 else b""
    path.write_bytes(head + (y.astype("<f8").tobytes() if form == 3 else packed.tobytes()))
    return y if form == 3 else (packed - offset.astype(float)) / scale.astype(float)


def table(y, form, separator):
    return "".join(separator.join([f"{t:.2f}", *(form % v for v in row)]) + "\n" for t,
                   row in zip(T, y))


def openfast_out(path, y=Y):
    path.write_text("\nPredictions were generated on 22-Nov-2026 at 12:00:00 using OpenFAST\n "
                    "linked with NWTC Subroutine Library; ElastoDyn\n\n"
                    "Description from the FAST input file: a test, 3.5 m\n\n"
                    + "\t".join(n.ljust(10) for n in ("Time", *NAMES)) + "\n"
                    + "\t".join(u.ljust(10) for u in ("(s)", *3 * ["(m/s^2)"])) + "\n"
                    + table(y, "%25.17e", "\t"))


def text(path, y=Y):
    path.write_text("t," + ",".join(NAMES) + "\n" + table(y, "%.17g", ","))


EXACT = {
    "mat": mat, "mat compressed": lambda path: mat(path, compressed=True),
    "mat big endian": mat_big_endian, "mat 7.3": mat_73,
    "npy": npy, "npz": npz, "npz deflated": lambda path: npz(path, save=np.savez_compressed),
    "hdf5": hdf5,
    "58b": uff, "58b big endian": lambda path: uff(path, big=True),
    "outb of doubles": lambda path: outb(path, form=3),
    "out": openfast_out, "csv": text,
}
OTHERS = {
    "58": lambda path: uff(path, binary=False), "outb": outb,
    "outb with times": lambda path: outb(path, form=1),
    "outb with a step": lambda path: outb(path, form=2),
}
MORE = {"npy": ["--dt", str(DT)]}                  # which says no step


def modes(document):
    """Frequency and damping of each mode, the three largest, by frequency."""
    largest = sorted(document["modes"], key=lambda m: -m["amplitude"])[:3]
    return np.array(sorted((m["frequency_hz"], m["damping_ratio"]) for m in largest))


@pytest.fixture(scope="module")
def asked(ctl, tmp_path_factory):
    """The modes of samples, by way of the HDF5 file that modald defines."""
    folder, known = tmp_path_factory.mktemp("asked"), {}

    def ask(y):
        key = y.tobytes()
        if key not in known:
            known[key] = modes(ctl("identify", write_batch(folder / f"{len(known)}.h5", y, DT),
                                   "-o", "rank.fixed=6").document)
        return known[key]
    return ask


@pytest.mark.parametrize("kind", EXACT)
def test_the_same_doubles_in_every_format_have_the_same_modes(kind, ctl, asked, tmp_path):
    path = tmp_path / "no-suffix"
    EXACT[kind](path)
    said = ctl("identify", path, "-o", "rank.fixed=6", *MORE.get(kind, []))
    assert said.status == 0, said.document
    assert np.allclose(modes(said.document), asked(Y), rtol=1e-9, atol=0), modes(said.document)
    assert np.allclose(modes(said.document), [m[:2] for m in MODES], rtol=1e-6, atol=0)


@pytest.mark.parametrize("kind", OTHERS)
def test_rounded_samples_have_the_modes_of_what_the_file_holds(kind, ctl, asked, tmp_path):
    """Sixteen bits and a scale: the modes of the numbers that the description says are stored; text
    of 13 digits: to those."""
    path = tmp_path / "no-suffix"
    stored = OTHERS[kind](path)
    said = ctl("identify", path, "-o", "rank.fixed=6")
    assert said.status == 0, said.document
    assert np.allclose(modes(said.document), asked(Y if stored is None else stored), rtol=1e-8,
                       atol=0)


def test_integers_singles_rows_and_fortrans_order_are_samples_too(ctl, tmp_path):
    whole = np.round(1000 * Y).astype("<i4")
    single = Y.astype(">f4")
    small = np.round(50 * Y)
    for name, x, also in (("int", whole, whole), ("single", single, single),
                          ("fortran", np.asfortranarray(Y), Y),
                          ("bytes", small.astype("i1"), small)):
        npy(tmp_path / name, x)
        got = ctl("identify", tmp_path / name, "--dt", DT, "-o", "rank.fixed=6").document
        want = ctl("identify", write_batch(tmp_path / "want.h5", np.asarray(also, float), DT), "-o",
                   "rank.fixed=6").document
        assert got["modes"] == want["modes"], name
    mat(tmp_path / "row", Y[:, 0][None, :])
    assert ctl("identify", tmp_path / "row", "-o",
               "rank.fixed=6").document["provenance"]["input"]["samples"] == SAMPLES
    mat(tmp_path / "turned", Y.T, t=T)
    got = ctl("identify", tmp_path / "turned", "-o", "rank.fixed=6").document["provenance"]["input"]
    assert (got["samples"], got["channels"]) == (SAMPLES, 3)


def netcdf(path, unit):
    """HDF5 as xarray and h5py leave it: a unit is an attribute of the times."""
    with h5py.File(path, "w") as file:
        file["accel"], file["time"] = Y, T
        file["time"].attrs["units"] = unit


SAYS_UNIT = {
    "mat": lambda path, unit: scipy.io.savemat(path, {"accel": Y, f"t_{unit}": T}),
    "npz": lambda path, unit: np.savez(open(path, "wb"), **{f"time [{unit}]": T, "accel": Y}),
    "hdf5": netcdf,
    "hdf5 by fixed text": lambda path, unit: netcdf(path, np.bytes_(unit)),
    "58": lambda path, unit: uff(path, binary=False, time=("Time", unit)),
    "58b": lambda path, unit: uff(path, time=("NONE", unit)),
    "58 uneven": lambda path, unit: uff(path, even=False, time=(f"Time [{unit}]", "NONE")),
    "outb": lambda path, unit: outb(path, time=f"({unit})"),
}


@pytest.mark.parametrize("unit", ["ms", "min"])
@pytest.mark.parametrize("kind", SAYS_UNIT)
def test_times_of_a_file_in_another_unit_than_seconds_are_refused_with_the_unit(kind, unit, ctl,
                                                                               tmp_path):
    """They were taken for seconds, or passed over without a word."""
    SAYS_UNIT[kind](tmp_path / "x", unit)
    error = ctl("identify", tmp_path / "x").document["error"]
    assert (error["code"], error["field"]) == ("bad_input", "time"), error
    assert f"in {unit};" in error["message"] and "--ignore-time" in error["message"], error
    assert "what is no time needs another name" in error["message"], error
    assert ctl("identify", tmp_path / "x", "--dt", DT, "--ignore-time", "-o",
               "rank.fixed=6").status == 0


def identified(ctl, path, *words):
    """Are the modes of PATH those of Y?"""
    said = ctl("identify", path, *words, "-o", "rank.fixed=6")
    assert said.status == 0, said.document
    return np.allclose(modes(said.document), [m[:2] for m in MODES], rtol=1e-3)


@pytest.mark.parametrize("kind", SAYS_UNIT)
def test_times_of_a_file_that_say_seconds_are_its_times(kind, ctl, tmp_path):
    SAYS_UNIT[kind](tmp_path / "x", "s")
    assert identified(ctl, tmp_path / "x")


@pytest.mark.parametrize("unit", ["hrs", "milliseconds since 2020-01-01 00:00:00",
                                  np.bytes_("days since 1970-01-01 00:00:00.000000 UTC")])
def test_units_written_out_and_what_they_count_from_are_units(unit, ctl, tmp_path):
    """Those of more than 31 characters, as xarray writes them, were none."""
    netcdf(tmp_path / "x", unit)
    error = ctl("identify", tmp_path / "x").document["error"]
    assert error["field"] == "time", error
    assert f"in {np.bytes_(unit).split()[0].decode()};" in error["message"], error


@pytest.mark.parametrize("unit", ["seconds since 2020-01-01 00:00:00.000000", "s" + 200 * " ",
                                  np.bytes_("sec" + 200 * " "), "s\u00b2" * 100])
def test_seconds_since_a_day_and_what_is_no_unit_are_seconds(unit, ctl, tmp_path):
    netcdf(tmp_path / "x", unit)
    assert identified(ctl, tmp_path / "x")


def step_of_unit(path, name, value, unit):
    with h5py.File(path, "w") as file:
        file["accel"], file[name] = Y, value
        file[name].attrs["units"] = unit


@pytest.mark.parametrize("name, value, unit", [("dt", 1e3 * DT, "ms"), ("fs", 1e-3 / DT, "kHz"),
                                               ("Fs", 1e-6 / DT, "MHz"), ("fs", 1e3 / DT, "mHz"),
                                               ("dt", 1 / DT, "Hz")])
def test_a_step_and_a_rate_in_another_unit_are_refused_with_the_unit(name, value, unit, ctl,
                                                                     tmp_path):
    """They were taken for s and Hz."""
    step_of_unit(tmp_path / "x", name, value, unit)
    error = ctl("identify", tmp_path / "x").document["error"]
    assert (error["code"], error["field"]) == ("bad_input", name), error
    assert f"`{name}` is in {unit}; accepted: in {'s' if name == 'dt' else 'Hz'}, or --dt" \
        in error["message"], error
    assert identified(ctl, tmp_path / "x", "--dt", DT, "--ignore-time")


@pytest.mark.parametrize("name, value, unit", [("dt", DT, "s"), ("fs", 1 / DT, "Hz"),
                                               ("fs", 1 / DT, "S/s"), ("fs", 1 / DT, "1/s")])
def test_a_step_in_s_and_a_rate_in_hz_are_the_signals_own(name, value, unit, ctl, tmp_path):
    step_of_unit(tmp_path / "x", name, value, unit)
    assert identified(ctl, tmp_path / "x")


def test_a_temperature_and_a_delay_beside_signals_are_no_times(ctl, tmp_path):
    mat(tmp_path / "x", T_h=20 + T, t_ms=3.0, T_ms=T)
    assert ctl("identify", tmp_path / "x", "--dataset", "accel", "-o", "rank.fixed=6").status == 0


WARM = 20 + np.sin(T)


@pytest.mark.parametrize("beside", [
    {"dt": DT, "t_s": WARM}, {"fs": 1 / DT, "t_min": Y.min(axis=1)}, {"dt": DT, "t_h": 20 + T},
    {"t": T, "t_ms": 1e3 * T}, {"t_h": T / 3600, "t_s": T}, {"time": T, "t_d": 0 * T},
    {"t_ms": WARM, "t_s": T}, {"t_ms": np.full(3, 1.0), "time_s": T}, {"dt": DT, "t_s": T[:3]}],
    ids=lambda beside: "-".join(beside))
def test_what_has_a_unit_in_its_name_is_no_time_beside_what_says_the_step(beside, ctl, tmp_path):
    """A temperature `t_s` was taken for times that do not grow, and the file was refused."""
    np.savez(tmp_path / "x.npz", accel=Y, **beside)
    assert identified(ctl, tmp_path / "x.npz")


def test_what_has_a_unit_in_its_name_and_does_not_grow_says_no_step(ctl, tmp_path):
    np.savez(tmp_path / "x.npz", accel=Y, t_ms=WARM)
    error = ctl("identify", tmp_path / "x.npz").document["error"]
    assert error["field"] == "dt" and "nothing says the step" in error["message"], error
    assert identified(ctl, tmp_path / "x.npz", "--dt", DT)


def test_a_matrix_with_a_unit_in_its_name_may_be_the_signals(ctl, tmp_path):
    """It was none, and another was taken without a word."""
    np.savez(tmp_path / "x.npz", t_d=Y, x=np.ones((100, 2)), dt=DT)
    error = ctl("identify", tmp_path / "x.npz").document["error"]
    assert error["field"] == "dataset" and "t_d (2000 x 3)" in error["message"], error
    np.savez(tmp_path / "y.npz", time_d=Y, dt=DT)
    assert identified(ctl, tmp_path / "y.npz")


def test_uneven_abscissae_and_singles_of_a_universal_file_are_read(ctl, tmp_path):
    uff(tmp_path / "x.unv", even=False)
    assert np.allclose(modes(ctl("identify", tmp_path / "x.unv", "-o", "rank.fixed=6").document),
                       [m[:2] for m in MODES], rtol=1e-5)
    uff(tmp_path / "y.unv", wide=False)
    got = ctl("identify", tmp_path / "y.unv", "-o", "rank.fixed=6").document
    want = ctl("identify", write_batch(tmp_path / "want.h5", Y.astype("f4").astype(float), DT),
               "-o", "rank.fixed=6").document
    assert np.array_equal(modes(got), modes(want))


def test_all_but_hdf5_and_sound_may_come_by_a_pipe(ctl, asked, tmp_path):
    for kind in ("mat", "npz", "58b", "outb of doubles", "out"):
        EXACT[kind](tmp_path / "x")
        with open(tmp_path / "x", "rb") as stdin:
            done = subprocess.run([BUILD / "bin" / "modalctl", "--local", "--json", "identify", "-",
                                   "-o", "rank.fixed=6"], stdin=stdin,
                                  capture_output=True, timeout=PATIENCE, env=environment())
        assert np.allclose(modes(json.loads(done.stdout)), asked(Y), rtol=1e-9), kind


def test_lines_passed_over_before_a_table_are_counted_and_names_and_units_are_read(ctl, tmp_path):
    openfast_out(tmp_path / "x.out")
    said = ctl("identify", tmp_path / "x.out", "-o", "signals=tip")
    assert said.status == 0 and "3 lines before the columns were passed over" in said.err, said.err
    assert said.document["provenance"]["input"]["units"] == "(m/s^2)"


# -- what is in a file
# -------------------------------------------------------------------------------------------------

def refused(ctl, path, *words):
    said = ctl("identify", path, *words)
    assert said.status == 2 and said.document["error"]["code"] == "bad_input", said.document
    return said.document["error"]["field"], said.document["error"]["message"]


@pytest.mark.parametrize("write", [mat, npz, lambda path, **more: write_two(path, **more)])
def test_of_several_arrays_dataset_names_one_and_without_it_they_are_listed(write, ctl, tmp_path):
    path = tmp_path / "x"
    write(path, force=Y[:, :1] + 1)
    field, message = refused(ctl, path)
    assert (field == "dataset" and "accel (2000 x 3)" in message
            and "force (2000 x 1)" in message), message
    assert ctl("identify", path, "--dataset",
               "force").document["provenance"]["input"]["channels"] == 1
    field, message = refused(ctl, path, "--dataset", "forces")
    assert field == "dataset" and "`forces`" in message and "force (2000 x 1)" in message, message


def write_two(path, **more):
    with h5py.File(path, "w") as file:
        for name, x in {"accel": Y, **more}.items():
            file.create_dataset(name, data=x)
        file.attrs["fs"] = 1 / DT


def test_what_is_no_matrix_is_said_by_name(ctl, tmp_path):
    mat(tmp_path / "x", Y * 1j)
    field, message = refused(ctl, tmp_path / "x")
    assert field == "dataset" and "accel (complex)" in message and "note (text)" in message, message
    field, message = refused(ctl, tmp_path / "x", "--dataset", "note")
    assert field == "dataset" and "`note` is text" in message, message
    mat(tmp_path / "y", {"deep": Y})
    assert "accel (a struct)" in refused(ctl, tmp_path / "y")[1]
    npy(tmp_path / "z", Y.astype(complex))
    assert refused(ctl, tmp_path / "z")[0] == "signals"
    text(tmp_path / "t.csv")
    assert refused(ctl, tmp_path / "t.csv", "--dataset", "accel")[0] == "dataset"


def test_groups_inside_each_other_and_in_a_ring_are_walked_once(ctl, tmp_path):
    """libhdf5's own walk takes minutes for 3000 groups; a name has 255 bytes at most."""
    path = tmp_path / "deep.h5"
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")
        group["signals"] = Y
    assert "groups whose names are longer than 255 bytes" in refused(ctl, path)[1]
    path = tmp_path / "ring.h5"
    with h5py.File(path, "w") as file:
        file["a/b/one"] = Y
        file["a/b/two"] = Y[:5]
        file["a/b/up"] = file["a"]
        file["a/also"] = file["a/b/one"]
        file["soft"] = h5py.SoftLink("/a/b/one")
    said = refused(ctl, path)[1]
    assert said.count("a/also") + said.count("a/b/one") == 1 and said.count("a/b/two") == 1, said


@pytest.mark.parametrize("write", [mat, npz, write_two])
def test_a_file_that_says_two_steps_or_an_absurd_one_is_refused(write, ctl, tmp_path):
    path = tmp_path / "x"
    write(path, time=T * 1.5)
    field, message = refused(ctl, path)
    assert field == "dt" and "0.015" in message and "0.01 " in message, message
    said = ctl("identify", path, "--ignore-time", "--dt", DT)
    assert said.status == 0, said.document
    write(path, time=T ** 2)
    assert refused(ctl, path)[0] == "time"
    write(path, t=T[:-7])
    assert refused(ctl, path)[0] == "t"
    write(path, fs=-3.0) if write is mat else write(path, Fs=-3.0)
    field, message = refused(ctl, path)
    assert field in ("fs", "Fs") and "-3" in message and "positive" in message, message
    write(path)
    assert refused(ctl, path, "--dt", "0.02")[0] == "dt"


def test_a_file_without_a_step_asks_for_it(ctl, tmp_path):
    npy(tmp_path / "x")
    field, message = refused(ctl, tmp_path / "x")
    assert field == "dt" and "--dt SECONDS" in message and "fs" in message, message


def test_functions_that_are_no_time_responses_are_named(ctl, tmp_path):
    uff(tmp_path / "x.unv", function=4)
    field, message = refused(ctl, tmp_path / "x.unv")
    assert (field == "file" and "type 4 (frequency response)" in message
            and "time response" in message), message


# -- damage
# --------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("kind", [k for k in {**EXACT, **OTHERS} if k not in ("out", "csv")])
def test_a_file_cut_anywhere_is_an_error(kind, ctl, tmp_path):
    """At every hundredth of it with MODALD_LONG, else at some; tests/unit cuts small ones at every
    byte."""
    write = {**EXACT, **OTHERS}[kind]
    write(tmp_path / "whole")
    whole = (tmp_path / "whole").read_bytes()
    for part in PARTS:
        (tmp_path / "cut").write_bytes(whole[:len(whole) * part // 100])
        said = ctl("identify", tmp_path / "cut", *MORE.get(kind, []))
        assert said.status == 2 and said.document["error"]["field"], (part, said.document)
        assert "cut" in said.document["error"]["message"], (part, said.document)


@pytest.mark.parametrize("kind", ["out", "csv"])
def test_text_cut_anywhere_is_an_error_or_says_how_much_is_left(kind, ctl, tmp_path):
    EXACT[kind](tmp_path / "whole")
    whole = (tmp_path / "whole").read_bytes()
    for part in PARTS:
        cut = whole[:len(whole) * part // 100]
        (tmp_path / "cut").write_bytes(cut)
        said = ctl("identify", tmp_path / "cut", "-o", "rank.fixed=2")
        if said.status == 2:
            assert said.document["error"]["field"], (part, said.document)
            continue
        rows = said.document["provenance"]["input"]["samples"]
        assert (cut.endswith(b"\n") or f"may be cut short: {rows} samples"
                in said.err), (part, said.err)
        assert rows < SAMPLES


def patched(data, at, new):
    return data[:at] + new + data[at + len(new):]


def test_headers_that_promise_the_absurd_cost_nothing_and_are_refused(ctl, tmp_path):
    """Sizes past the file's length, in each header that states sizes."""
    path = tmp_path / "x"
    huge = 2 ** 31 - 1
    cases = []
    npy(path)
    data = path.read_bytes()
    cases.append(("npy", data.replace(b"(2000, 3)", b"(99999,3)")))
    mat(path)
    data = path.read_bytes()
    cases.append(("mat", data.replace(struct.pack("<ii", SAMPLES, 3),
                                      struct.pack("<ii", huge, huge), 1)))
    outb(path)
    data = path.read_bytes()
    cases.append(("outb", patched(data, 8, struct.pack("<i", huge))))
    cases.append(("outb negative", patched(data, 4, struct.pack("<i", -3))))
    uff(path, announced=999999999)
    cases.append(("58b", path.read_bytes()))
    uff(path, binary=False, announced=999999999)
    cases.append(("58", path.read_bytes()))
    npz(path)
    data = path.read_bytes()
    at = data.rindex(b"PK\5\6")
    cases.append(("npz directory", patched(data, at + 16, struct.pack("<I", 2 ** 32 - 2))))
    at = data.index(b"PK\1\2")
    cases.append(("npz sizes", patched(data, at + 20, struct.pack("<II", huge, huge))))
    cases.append(("npz zip64",
                  patched(data, at + 20, struct.pack("<II", 2 ** 32 - 1, 2 ** 32 - 1))))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as zipped:
        zipped.writestr("y.npy", bytes(10 ** 6))
    cases.append(("npz without an array", packed.getvalue()))
    for name, bad in cases:
        path.write_bytes(bad)
        said = ctl("identify", path, "--dt", DT)
        assert (said.status == 2 and said.document["error"]["field"]
                in ("file", "signals")), (name, said.document)


def test_numbers_that_are_not_in_the_hdf5_file_itself_are_none(ctl, tmp_path):
    """Never written, of which there may be more than any memory; or in another file, that only who
    reads it may read."""
    other, path = tmp_path / "other.h5", tmp_path / "x.h5"
    hdf5(other)
    (tmp_path / "secret").write_bytes(bytes(range(200)))
    virtual = h5py.VirtualLayout(shape=(SAMPLES, 3), dtype="f8")
    virtual[:] = h5py.VirtualSource(other, "run/accel", shape=(SAMPLES, 3))
    cases = {
        "never written": lambda f: f.create_dataset("signals", (2 ** 27, 8), "f8"),
        "never written, in chunks": lambda f: f.create_dataset("signals", (2 ** 27, 8), "f8",
                                                               chunks=(4096, 8)),
        "in other files": lambda f: f.create_virtual_dataset("signals", virtual),
        "in other files, as they lie": lambda f: f.create_dataset(
            "signals", (200, 1), "u1", external=[(str(tmp_path / "secret"), 0, 200)])}
    for said, write in cases.items():
        with h5py.File(path, "w", libver="latest") as f:
            write(f).attrs["dt"] = DT
        field, text = refused(ctl, path)
        assert field == "signals" and said.split(",")[0] in text, (said, text)
    with h5py.File(path, "w") as f:                 # of much that is the same, deflate makes little
        y = np.zeros((2 ** 18, 1))
        y[:50, 0] = Y[:50, 0]
        f.create_dataset("signals", data=y, chunks=(2 ** 18, 1), compression=9).attrs["dt"] = DT
        assert f["signals"].id.get_storage_size() < 5000
    assert ctl("export", path, "-O", tmp_path / "y.h5").status == 0
    with h5py.File(path, "w") as f:                 # and two filters still less
        relay = (np.arange(2 ** 21) < 50).astype("i4")[:, None]
        f.create_dataset("signals", data=relay, chunks=(2 ** 15, 1), scaleoffset=0,
                         compression=9).attrs["dt"] = DT
        assert 2000 * f["signals"].id.get_storage_size() < relay.nbytes
    assert ctl("export", path, "-O", tmp_path / "y.h5").status == 0


def test_a_flipped_bit_in_a_compressed_file_is_an_error(ctl, tmp_path):
    for name, write in (("npz", EXACT["npz deflated"]), ("mat", EXACT["mat compressed"])):
        write(tmp_path / name)
        data = bytearray((tmp_path / name).read_bytes())
        data[len(data) // 3] ^= 0x10
        (tmp_path / name).write_bytes(data)
        assert refused(ctl, tmp_path / name)[0] == "file"


def deflated_mat(path, rows, columns, spoil=0):
    """Zeros, and a checksum that is not theirs by SPOIL."""
    def element(kind, data):
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    head = (element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", rows, columns))
            + element(1, b"accel") + struct.pack("<II", 9, 8 * rows * columns))
    packed = bytearray(zlib.compress(struct.pack("<II", 14, len(head) + 8 * rows * columns) + head
                                     + bytes(8 * rows * columns)))
    packed[-1] ^= spoil
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
                     + struct.pack("<II", 15, len(packed)) + packed)


def peak(path):
    """Bytes that modalctl held at once to read PATH, in which nothing moves; told by a program
    between, for what is counted begins with what its parent holds."""
    run = subprocess.run([sys.executable, "-c", "import resource, subprocess, sys\n"
                          "subprocess.run(sys.argv[1:])\n"
                          "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)",
                          str(BUILD / "bin" / "modalctl"), "--local", "identify", path, "--dt",
                          str(DT)], capture_output=True, env=environment(), text=True)
    assert "no motion to identify" in run.stderr, run
    return 1024 * int(run.stdout)


@pytest.mark.parametrize("write", [
    deflated_mat,
    lambda path, rows, columns: npz(path, np.zeros((columns, rows)).T, np.savez_compressed)])
def test_a_compressed_matrix_takes_the_memory_of_its_numbers_once(write, tmp_path):
    """Beside them there was what it was inflated to, and then the numbers before they are turned.
    Where two fit, three of them would not: 1.5."""
    small, large, rows = tmp_path / "small", tmp_path / "large", 2 ** 20
    write(small, 100, 2)
    write(large, rows, 2)
    assert large.stat().st_size < 10 ** 5
    assert peak(large) - peak(small) < 1.5 * 8 * 2 * rows


@pytest.mark.parametrize("rows", [10, 2000, 2048, 2048 * 4 - 9])
def test_a_wrong_checksum_behind_all_numbers_is_an_error(rows, ctl, tmp_path):
    """Short, and ending within, at and beyond a piece of what is inflated at a time."""
    for spoil, status in ((0, 0), (1, 2)):
        deflated_mat(tmp_path / "x", rows, 2, spoil)
        said = ctl("export", tmp_path / "x", "--dt", DT, "-O", tmp_path / "y.h5")
        assert said.status == status, said.document


def test_export_writes_what_identify_reads_and_keeps_what_the_file_says(ctl, tmp_path):
    npz(tmp_path / "x.npz", period=5.0)
    said = ctl("export", tmp_path / "x.npz", "-O", tmp_path / "y.h5", "--scale", 2)
    assert said.document == {"output": str(tmp_path / "y.h5"), "samples": SAMPLES, "channels": 3,
                             "dt": DT}
    with h5py.File(tmp_path / "y.h5") as file:
        assert np.array_equal(file["signals"][...], 2 * Y) and file["signals"].attrs["dt"] == DT
    assert ctl("export", tmp_path / "y.h5", "-O", tmp_path / "y.csv").status == 0
    assert np.array_equal(np.loadtxt(tmp_path / "y.csv", delimiter=",", skiprows=1)[:, 1:], 2 * Y)
    for words in (["-O", tmp_path / "y.mat"], []):
        said = ctl("export", tmp_path / "x.npz", *words)
        assert said.status == 2 and said.document["error"]["field"] == "output"
    np.save(tmp_path / "x.npy", Y)
    said = ctl("export", tmp_path / "x.npy", "-O", tmp_path / "z.h5")
    assert said.document["error"]["field"] == "dt" and not (tmp_path / "z.h5").exists()
