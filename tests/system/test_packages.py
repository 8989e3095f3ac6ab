"""The Debian packages: that they hold all of what is installed, and, with MODALD_LONG, that a bare
Debian 12 takes, uses, upgrades, removes and purges them.
"""
import collections
import fnmatch
import json
import os
import pathlib
import re
import shutil
import subprocess

import pytest

import sanitized
from conftest import BUILD, TOP

pytestmark = pytest.mark.skipif(sanitized.SANITIZED,
                                reason="a build with sanitizers is not installed")
DEBIAN = TOP / "systemd" / "debian"
EARLIER = TOP / "tests" / "data" / "earlier"
TOLD = json.loads((EARLIER / "told.json").read_text())
PACKAGES = ["libmodald-client0", "libmodald-dev", "libmodald-stream0", "modalctl", "modald",
            "modald-slurm", "modald-web", "python3-modald"]
OLDER, OLD_COMMIT = "0.0.9", "5412946"          # of before there were packages


def control():
    """Package to its paragraph."""
    return {re.search(r"^Package: (\S+)", text, re.M)[1]: text
            for text in (DEBIAN / "control").read_text().split("\n\n") if "Package: " in text}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """What `cmake --install` gives, by the paths that it has with the prefix /usr."""
    root = tmp_path_factory.mktemp("root")
    subprocess.run(["cmake", "--install", str(BUILD), "--prefix", str(root / "usr")], check=True,
                   capture_output=True)
    found = [str(p.relative_to(root)) for p in root.rglob("*") if not p.is_dir()]
    for of_local, of_usr in (("^usr/etc/", "etc/"), (r"/python3\.\d+/", "/python3/"),
                             ("^usr/lib/(lib|pkgconfig/|fortran/)", r"usr/lib/ARCH/\1")):
        found = [re.sub(of_local, of_usr, file) for file in found]
    return root, found


def test_every_installed_file_is_in_one_package_and_every_line_of_a_package_names_some(files):
    where = collections.defaultdict(list)
    for package in control():
        for line in (DEBIAN / f"{package}.install").read_text().splitlines():
            pattern = line.split()[0]
            hits = [f for f in files[1] if fnmatch.fnmatchcase(f, pattern)
                    or fnmatch.fnmatchcase(f, pattern + "/*")]
            assert hits, f"{package}: nothing is {pattern}"
            for hit in set(hits):
                where[hit].append(package)
    twice = {f: p for f, p in where.items() if len(set(p)) > 1}
    assert not twice and set(where) == set(files[1])
    assert sorted(control()) >= PACKAGES


def test_the_symbols_files_name_what_the_libraries_show(files):
    for name in ("stream", "client"):
        library = next((files[0] / "usr").glob(f"lib/**/libmodald-{name}.so.0"))
        shown = subprocess.run(["nm", "-D", "--defined-only", str(library)], capture_output=True,
                               text=True, check=True).stdout
        told = (DEBIAN / f"libmodald-{name}0.symbols").read_text()
        ours = {s for s in re.findall(r" T (\w+)$", shown, re.M)}
        assert ours and ours == set(re.findall(r"^ (\w+)@Base ", told, re.M))


def test_pkg_config_needs_no_pc_file_of_others(files):
    pc = sorted((files[0] / "usr").glob("lib/**/pkgconfig/*.pc"))
    assert {p.stem for p in pc} >= {"modal", "modald-stream", "modald-client"}
    for path in pc:
        done = subprocess.run(["pkg-config", "--static", "--cflags", "--libs", path.stem],
                              env={**os.environ, "PKG_CONFIG_LIBDIR": str(path.parent)},
                              capture_output=True, text=True, check=False)
        assert done.returncode == 0 and f"-l{path.stem}" in done.stdout, done.stderr


def test_versions_and_what_building_needs_are_said_once():
    version = re.search(r"project\(modald VERSION (\S+)", (TOP / "CMakeLists.txt").read_text())[1]
    assert (DEBIAN / "changelog").read_text().startswith(f"modald ({version}) ")
    assert f"## {version}" in (TOP / "CHANGELOG.md").read_text()
    building = re.search(r"building=\((.*?)\)", (TOP / "tests/run").read_text(), re.S)[1].split()
    needed = re.search(r"Build-Depends:(.*?)\n\S", (DEBIAN / "control").read_text(), re.S)[1]
    needed = {word.strip().split(" ")[0] for word in needed.split(",")}
    # gcc and libc6-dev are build-essential; the rest is for packages and the Fortran module
    assert set(building) - {"gcc", "libc6-dev"} == needed - {"debhelper-compat", "dh-python",
                                                             "gfortran", "python3"}


# -- a bare Debian 12 -----------------------------------------------------------------------------

def missing():
    """Why the rest is skipped, or None."""
    if not os.environ.get("MODALD_LONG"):
        return "a build of the packages and a bare root: with MODALD_LONG=1"
    if os.geteuid() != 0:
        return "a bare root is made by root"
    for tool in ("debootstrap", "dpkg-buildpackage", "dh", "dh_python3", "lintian", "unshare"):
        if shutil.which(tool) is None:
            return f"{tool} is not installed"
    if subprocess.run(["git", "-C", str(TOP), "cat-file", "-e", f"{OLD_COMMIT}^{{commit}}"],
                      capture_output=True, check=False).returncode != 0:
        return f"this copy of the repository has no commit {OLD_COMMIT}"
    return None


class Root:
    """A bare Debian 12; each script has its own processes, which end with it."""

    def __init__(self, folder):
        self.path = folder / "root"
        lists = pathlib.Path("/etc/apt/sources.list.d/debian.sources")
        url = re.search(r"^URIs: (\S+)", lists.read_text(), re.M)[1]
        subprocess.run(["debootstrap", "--variant=minbase", "--include=ca-certificates",
                        "bookworm", str(self.path), url], check=True, capture_output=True)
        (self.path / "etc/apt/sources.list").unlink(missing_ok=True)
        for name in (lists, *pathlib.Path("/etc/apt/apt.conf.d").glob("99*"),
                     pathlib.Path("/etc/resolv.conf"), pathlib.Path("/etc/hosts")):
            shutil.copy(name, self.path / str(name)[1:])

    def run(self, script):
        enter = ('mount -t proc proc "$0/proc" && mount --bind /dev "$0/dev" && exec chroot "$0" '
                 '/usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 '
                 'DEBIAN_FRONTEND=noninteractive /bin/bash -euo pipefail -c "$1"')
        done = subprocess.run(["unshare", "--mount", "--pid", "--fork", "--kill-child", "/bin/sh",
                               "-c", enter, str(self.path), script], capture_output=True,
                              text=True, check=False)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        return done.stdout


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    if missing():
        pytest.skip(missing())
    folder = tmp_path_factory.mktemp("packages")
    subprocess.run([str(TOP / "systemd/package"), str(folder)], check=True)
    return folder


def test_lintian_finds_no_error(packages):
    done = subprocess.run(["lintian", "--allow-root", "--fail-on", "error",
                           *map(str, packages.glob("*.changes"))], capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_modalctl_depends_on_the_libraries_that_it_loads_itself(packages):
    deb = next(packages.glob("modalctl_*.deb"))
    told = subprocess.run(["dpkg-deb", "-f", str(deb), "Depends"], capture_output=True, text=True,
                          check=True).stdout
    assert {"libfftw3-double3", "libhdf5-103-1", "liblapacke", "libopenblas0", "libsndfile1",
            "libsqlite3-0", "libssl3",
            "libumfpack5", "libzmq5"} <= {word.split()[0] for word in told.split(", ")}


def old_tree(folder):
    """What OLD_COMMIT installs, built from its source, and the names of its files."""
    source, tree = folder / "source", folder / "tree"
    source.mkdir(parents=True)
    archive = subprocess.run(["git", "-C", str(TOP), "archive", OLD_COMMIT], check=True,
                             capture_output=True).stdout
    subprocess.run(["tar", "-x", "-C", str(source)], input=archive, check=True)
    for words in (["cmake", "-S", ".", "-B", "build", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                   "-DCMAKE_INSTALL_PREFIX=/usr", "-DMODALD_TESTS=OFF"],
                  ["cmake", "--build", "build"], ["cmake", "--install", "build"]):
        subprocess.run(words, cwd=source, check=True, capture_output=True,
                       env={**os.environ, "DESTDIR": str(tree)})
    return tree, sorted(str(p.relative_to(tree)) for p in tree.rglob("*") if not p.is_dir())


def shares(names):
    """Package to those files of NAMES that it would have; what none has is the developers'."""
    left, out = set(names), {}
    for package in control():
        lines = (DEBIAN / f"{package}.install").read_text().splitlines()
        out[package] = {name: line.split()[1:] for line in lines for name in left
                        if fnmatch.fnmatchcase(name, line.split()[0])
                        or fnmatch.fnmatchcase(name, line.split()[0] + "/*")}
        left -= set(out[package])
    out["libmodald-dev"].update({name: [] for name in left})
    return out


def aged(packages, folder, work):
    """Packages of OLD_COMMIT: its files, divided and with the maintainer's scripts of now."""
    tree, names = old_tree(work)
    folder.mkdir()
    for package, files in shares(names).items():
        if not files:
            continue                                       # there is more now than there was
        deb = next(packages.glob(f"{package}_*.deb"))
        root = work / package
        subprocess.run(["dpkg-deb", "-R", str(deb), str(root)], check=True)
        for path in root.iterdir():
            if path.name != "DEBIAN":
                shutil.rmtree(path)
        for name, where in files.items():
            to = root / (f"{where[0]}/{pathlib.Path(name).name}" if where else name)
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(tree / name, to, follow_symlinks=False)
        (root / "DEBIAN/md5sums").unlink()
        text = (root / "DEBIAN/control").read_text()
        version = re.search(r"^Version: (\S+)$", text, re.M)[1]
        (root / "DEBIAN/control").write_text(text.replace(version, OLDER))
        subprocess.run(["dpkg-deb", "-b", "--root-owner-group", str(root), str(folder / deb.name)],
                       check=True, capture_output=True)


DAEMON = """
install -d -o modald -g modald -m 750 /run/modald
setpriv --reuid modald --regid modald --clear-groups modald --config /etc/modald/modald.conf \
  2>/tmp/log & daemon=$!
for i in $(seq 100); do
    modalctl hello >/dev/null 2>&1 && break
    kill -0 $daemon || cat /tmp/log
done
"""
# A job's page and its picture; and what the scaler would do, by a Slurm that has nothing.
BESIDE = r"""
modald-web --bind 127.0.0.1:0 2>/tmp/web & web=$!
for i in $(seq 600); do grep -q event=listening /tmp/web && break; sleep 0.1; done
at=$(sed -n 's,.*at=\(http://127.0.0.1:[0-9]*\)/.*,\1,p' /tmp/web)
job=$(modalctl --json list --key mine | sed -n 's/.*"job":"\([^"]*\)".*/\1/p' | head -n 1)
python3 - "$job" "$at" <<'END'
import sys, time, urllib.error, urllib.request
for path in (f"/jobs/{sys.argv[1]}", f"/jobs/{sys.argv[1]}.svg", "/metrics", "/"):
    for _ in range(600):
        try:
            with urllib.request.urlopen(sys.argv[2] + path) as answer:
                print(answer.headers["Content-Type"], answer.read().decode())
            break
        except urllib.error.URLError:
            time.sleep(0.1)
END
mkdir /tmp/stand; printf '#!/bin/sh\n' > /tmp/stand/squeue; chmod 755 /tmp/stand/squeue
PATH=/tmp/stand:$PATH modald-slurm --pool lab --least 2 --connect tcp://192.0.2.7:7418 \
  --worker-keyfile /root/worker.key --dry-run
kill $web; wait $web; cat /tmp/web; kill $daemon; wait $daemon
"""


def test_packages_are_installed_used_upgraded_removed_and_purged(packages, tmp_path):
    root = Root(tmp_path)
    aged(packages, root.path / "old", tmp_path / "work")
    (root.path / "new").mkdir()
    for deb in packages.glob("*.deb"):
        shutil.copy(deb, root.path / "new")
    shutil.copy(EARLIER / "folder.tar.xz", root.path / "tmp")
    root.run("apt-get update -qq; apt-get install -y -qq --no-install-recommends "
             "/old/*.deb python3-h5py pkg-config xz-utils gcc libc6-dev >/dev/null")
    assert root.run("dpkg-query -W -f '${Version}' modald") == OLDER
    (root.path / "etc/modald/modald.conf").open("a").write(
        "workers = 1\n" + "result_age_s = 3e9\ninput_age_s = 3e9\ntombstone_age_s = 3e9\n")
    kept = """
tar -x -C /tmp -f /tmp/folder.tar.xz && cp -a /tmp/data/. /var/lib/modald/
chown -R modald:modald /var/lib/modald
"""
    asked = """
awk 'BEGIN { print "t,a"; for (i = 0; i < 400; i++) printf "%.2f,%.9g\\n", i / 100,
  exp(-i / 500) * cos(i / 5) }' > /tmp/a.csv
modalctl submit identify /tmp/a.csv --key mine --wait >&2
"""
    listing = "modalctl --json list --limit 1000; kill $daemon; wait $daemon"
    mine = "modalctl --json result key:mine; kill $daemon; wait $daemon"
    before = json.loads(root.run(kept + DAEMON + asked + listing))["jobs"]
    own = json.loads(root.run(DAEMON + mine))
    assert own["modes"]
    states = {job["job"]: job["state"] for job in before}
    for name in ("done", "failed", "cancelled", "dead"):
        assert states[TOLD["jobs"][name]] == name
    # its configuration is changed and has changed: who is asked keeps his own
    root.run("apt-get install -y -qq --no-install-recommends -o Dpkg::Options::=--force-confold "
             "/new/*.deb >/dev/null")
    assert "workers = 1\n" in (root.path / "etc/modald/modald.conf").read_text()
    assert root.run("dpkg-query -W -f '${Version}' modald") != OLDER
    after = json.loads(root.run(DAEMON + listing))["jobs"]
    assert json.loads(root.run(DAEMON + mine)) == own
    assert {job["job"] for job in after} == set(states)
    assert all(job["state"] == states[job["job"]] for job in after
               if states[job["job"]] in ("done", "failed", "cancelled", "dead"))
    seen = root.run(DAEMON + BESIDE)
    assert "<dd>mine</dd>" in seen and "image/svg+xml" in seen and "damping_ratio" in seen
    assert "modald_web_requests_total" in seen and "event=listening" in seen
    assert "sbatch --parsable -J md-lab --array=1-2 -n1" in seen
    assert "modald-worker --connect tcp://192.0.2.7:7418" in seen
    root.run("export AUTOPKGTEST_TMP=$(mktemp -d)\n" + (DEBIAN / "tests/installed").read_text())
    assert root.run("pkg-config --cflags --libs modal modald-client modald-stream")
    names = " ".join(control())
    root.run(f"apt-get remove -y -qq {names} >/dev/null")
    assert not (root.path / "usr/sbin/modald").exists()
    assert (root.path / "var/lib/modald/ledger.db").exists()
    assert (root.path / "etc/modald/modald.conf").exists()
    root.run(f"dpkg --purge {names}")
    left = root.run("rm -rf /old /new /tmp/* /var/cache/apt; find / -xdev -name '*modald*' "
                    "-not -path '/proc/*' -not -path '/run/modald*'")
    assert left == ""
