"""What is installed, and that it is usable: libraries and headers by pkg-config, man pages,
completion, the hardened unit.
"""
import os
import pathlib
import re
import shutil
import subprocess

import pytest
from conftest import BUILD, TOP, environment

# What links our libraries would need the sanitizers' own runtime, and sizes mean nothing: these are
# for the build that is shipped.
shipped = pytest.mark.skipif(b"__asan_init" in (BUILD / "bin" / "modalctl").read_bytes(),
                             reason="a build with sanitizers is not installed")
PAGES = ["clients/ctl/modalctl.1", "systemd/modald.8", "systemd/modald-worker.8",
         "clients/slurm/modald-slurm.8",
         "systemd/modald-web.8",
         "clients/c/modald_stream.3", "clients/c/examples/modald-rosco-bridge.1",
         "clients/c/examples/modald-mbdyn-listener.1"]
UNITS = sorted((TOP / "systemd").glob("*.service"))


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("install") / "usr"
    subprocess.run(["cmake", "--install", str(BUILD), "--prefix", str(prefix)], check=True,
                   capture_output=True)
    return prefix


def library_folder(prefix):
    return next(path.parent for path in prefix.glob("lib/**/libmodal.a"))


def test_everything_is_where_debian_expects_it(installed):
    lib = library_folder(installed).relative_to(installed)
    for name in ("bin/modalctl", "sbin/modald", "sbin/modald-worker", f"{lib}/libmodal.a",
                 f"{lib}/libmodald-stream.a",
                 f"{lib}/libmodald-stream.so", f"{lib}/libmodald-client.so",
                 f"{lib}/pkgconfig/modal.pc", f"{lib}/pkgconfig/modald-stream.pc",
                 f"{lib}/pkgconfig/modald-client.pc", "include/modal/base/error.h",
                 "include/modal/batch.h", "include/modal/linalg/svd.h", "include/modald.h",
                 "include/modald_stream.h", "lib/systemd/system/modald.service",
                 "lib/sysusers.d/modald.conf", "lib/tmpfiles.d/modald.conf",
                 "share/man/man1/modalctl.1", "share/man/man8/modald.8",
                 "share/man/man8/modald-worker.8", "share/man/man8/modald-slurm.8",
                 "bin/modald-slurm", "lib/systemd/system/modald-slurm@.service",
                 "share/man/man3/modald_stream.3",
                 "share/man/man8/modald-web.8", "sbin/modald-web",
                 "lib/systemd/system/modald-web.service",
                 "share/man/man5/modald-scene.5", "share/man/man5/modald-result.5",
                 "share/man/man7/modald-identify.7", "share/man/man7/modald-steady.7",
                 "share/man/man7/modald-live.7", "share/man/man7/modald-lab.7",
                 "share/modald/modald_stream.c", "share/modald/modald-monitor.fmu",
                 "share/man/man1/modald-rosco-bridge.1", "share/man/man1/modald-mbdyn-listener.1",
                 "bin/modald-rosco-bridge", "bin/modald-mbdyn-listener",
                 "share/doc/modald/README.md", "share/doc/modald/examples/loop.c",
                 "share/doc/modald/proto/PROTOCOL.md",
                 "share/bash-completion/completions/modalctl",
                 "share/zsh/vendor-completions/_modalctl",
                 "share/fish/vendor_completions.d/modalctl.fish"):
        assert (installed / name).exists(), name
    assert list(installed.glob("lib/python3*/dist-packages/modald/client.py"))


def compile_and_run(installed, folder, suffix, source, package, compiler):
    (folder / f"a{suffix}").write_text(source)
    env = {**os.environ, "PKG_CONFIG_PATH": str(library_folder(installed) / "pkgconfig")}
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", package], env=env,
                           capture_output=True, text=True, check=True).stdout.split()
    subprocess.run([*compiler, "-Wall", "-Wextra", "-Werror", str(folder / f"a{suffix}"), "-o",
                    str(folder / "a"), *flags], check=True, capture_output=True)
    return subprocess.run([str(folder / "a")],
                          env=environment(LD_LIBRARY_PATH=library_folder(installed)),
                          capture_output=True, text=True)


@shipped
def test_libmodal_a_is_linked_by_what_pkg_config_says_of_static_linking(installed, tmp_path):
    (tmp_path / "a.c").write_text('''#include <stdio.h>
#include "modal/linalg/sparse_lu.h"
int main(void) { sparse_lu_free(NULL); puts("linked"); return 0; }
''')
    lib = library_folder(installed)
    env = {**os.environ, "PKG_CONFIG_PATH": str(lib / "pkgconfig")}
    said = subprocess.run(["pkg-config", "--static", "--cflags", "--libs", "modal"], env=env,
                          capture_output=True, text=True, check=True)
    flags = [str(lib / "libmodal.a") if flag == "-lmodal" else flag for flag in said.stdout.split()]
    linked = subprocess.run(["cc", str(tmp_path / "a.c"), "-o", str(tmp_path / "a"), *flags],
                            capture_output=True, text=True)
    assert linked.returncode == 0, linked.stderr
    assert (subprocess.run([str(tmp_path / "a")], capture_output=True, text=True,
                           check=True).stdout == "linked\n")


@shipped
def test_libmodal_is_usable_alone(installed, tmp_path):
    source = '''#include <stdio.h>
#include "base/error.h"
int main(void)
{
    puts(modal_status_code(MODAL_BAD_INPUT));
    return modal_status_exit(MODAL_TIMEOUT);
}
'''
    done = compile_and_run(installed, tmp_path, ".c", source, "modal", ["cc", "-std=c11"])
    assert done.stdout == "bad_input\n" and done.returncode == 5


@shipped
@pytest.mark.parametrize("suffix, compiler",
                         [(".c", ["cc", "-std=c89", "-pedantic"]), (".cpp", ["c++"])])
def test_the_client_headers_serve_old_c_and_cpp(suffix, compiler, installed, tmp_path):
    if shutil.which(compiler[0]) is None:
        pytest.skip(f"no {compiler[0]}")
    stream = '''#include "modald_stream.h"
int main(void)
{
    double y[2] = { 1, 2 };
    modald_stream *s = modald_open("a", 2, 0.1);
    modald_push(s, y);
    modald_close(s);
    return modald_verdict(s);
}
'''
    client = '''#include "modald.h"
int main(void)
{
    struct modald *m = 0;
    struct modald_error e;
    int status = modald_connect("nonsense", 0, &m, &e);
    modald_disconnect(m);
    return status;
}
'''
    assert (compile_and_run(installed, tmp_path, suffix, stream, "modald-stream",
                            compiler).returncode == 0)
    assert (compile_and_run(installed, tmp_path, suffix, client, "modald-client",
                            compiler).returncode == 2)


def test_the_stream_client_that_a_host_copies_compiles_alone_and_shows_its_calls_only(installed,
                                                                                      tmp_path):
    """One .c and one .h in an empty folder, by the compilers that are here; what it shows is what
    the header declares.
    """
    source, header = (installed / "share/modald/modald_stream.c",
                      installed / "include/modald_stream.h")
    declared = set(re.findall(r"\b(modald_\w+)\(",
                              re.sub(r"/\*.*?\*/", "", header.read_text(), flags=re.S)))
    for path in (source, header):
        shutil.copy(path, tmp_path)
    for compiler in filter(shutil.which, ("cc", "clang")):
        subprocess.run([compiler, "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-c",
                        "modald_stream.c", "-o", "a.o"], cwd=tmp_path, check=True)
        symbols = subprocess.run(["nm", "-g", "--defined-only", tmp_path / "a.o"],
                                 capture_output=True, text=True, check=True).stdout
        assert {line.split()[-1] for line in symbols.splitlines()} == declared


@shipped
def test_the_stream_library_is_small_and_needs_only_libzmq(installed):
    library = (library_folder(installed) / "libmodald-stream.so").resolve()
    needed = subprocess.run(["objdump", "-p", str(library)], capture_output=True, text=True,
                            check=True).stdout
    assert (set(re.findall(r"NEEDED\s+(\S+)", needed)) <= {"libzmq.so.5", "libm.so.6", "libc.so.6",
                                                           "libasan.so.8", "libubsan.so.1"})
    text, data, *_ = subprocess.run(["size", str(library)], capture_output=True, text=True,
                                    check=True).stdout.splitlines()[1].split()
    assert int(text) + int(data) < 100_000


def test_the_client_library_shows_nothing_but_its_header(installed):
    library = (library_folder(installed) / "libmodald-client.so").resolve()
    symbols = subprocess.run(["nm", "-D", "--defined-only", str(library)], capture_output=True,
                             text=True, check=True).stdout
    shown = {line.split()[-1].split("@")[0] for line in symbols.splitlines()}
    declared = set(re.findall(r"\b(modald_\w+)\(", (TOP / "clients/c/modald.h").read_text()))
    assert shown == declared


def verbs():
    out = subprocess.run([str(BUILD / "bin" / "modalctl"), "--help"], capture_output=True,
                         text=True, check=True).stdout
    return re.findall(r"^  ([a-z]+) ", out.split("options:")[0], re.M)


def options(verb):
    out = subprocess.run([str(BUILD / "bin" / "modalctl"), verb, "--help"], capture_output=True,
                         text=True, check=True).stdout
    return set(re.findall(r"--([a-z-]+) ", out.split("options:")[1]))


def plain(path):
    """A man page's text, with its dashes as dashes."""
    return re.sub(r"\\f[A-Z]", "", path.read_text().replace("\\-", "-"))


def test_the_man_page_names_every_verb_and_option():
    page = plain(TOP / "clients/ctl/modalctl.1")
    assert len(verbs()) > 20
    for verb in verbs():
        assert re.search(rf"\b{verb}\b", page), verb
        for option in options(verb):
            assert f"--{option}" in page, option


@pytest.mark.parametrize("kind", ["identify", "steady", "simulate", "floquet", "tradeoff", "sweep",
                                  "ablate", "stream"])
def test_the_man_page_has_the_options_of_each_kind_of_job_and_no_others(kind):
    told = subprocess.run([str(BUILD / "bin" / "modalctl"), kind, "--help"], capture_output=True,
                          text=True, check=True).stdout
    told = re.findall(r"^  (\S+=\S+|\(those of \w+\)) ", told.split("\n-o KEY=VALUE", 1)[1], re.M)
    page = plain(TOP / "clients/ctl/modalctl.1").split(".SH OPTIONS OF JOBS")[1].split("\n.SH ")[0]
    page = page.split(f".SS {kind}\n")[1].split(".SS ")[0].replace(r"\(dq", '"')
    assert told and re.findall(r"^\.B (.+)$", page, re.M) == told


@pytest.mark.parametrize("page", PAGES)
def test_man_pages_are_well_formed(page):
    text = (TOP / page).read_text()
    sections = re.findall(r"^\.SH (.+)$", text, re.M)
    assert (text.startswith(".TH ") and sections[:3] == ["NAME", "SYNOPSIS", "DESCRIPTION"]
            and ("EXIT STATUS" in sections or page.endswith(".3")) and sections[-1] == "SEE ALSO")
    if shutil.which("groff"):
        done = subprocess.run(["groff", "-man", "-ww", "-z", str(TOP / page)], capture_output=True,
                              text=True)
        assert done.stderr == ""


@shipped
def test_the_page_s_manual_shows_an_installed_picture_in_html_and_names_it_elsewhere(installed):
    if not list(pathlib.Path("/usr/share/groff").glob("*/font/devhtml")):
        pytest.skip("no groff that writes HTML: the package groff")

    def shown(device):
        return subprocess.run(["groff", f"-T{device}", "-P-l" if device == "html" else "-P-c",
                               "-man",
                               "-ww", str(installed / "share/man/man8/modald-web.8")],
                              capture_output=True, text=True, check=True).stdout
    picture = re.search(r'<img src="file:///usr/(\S+\.png)" alt="[^"]+">', shown("html"))[1]
    assert (installed / picture).read_bytes().startswith(b"\x89PNG")
    assert (re.sub(".\b", "", shown("ascii")).count(f"/usr/{picture}") == 2
            and "<img" not in shown("ascii"))


def test_the_daemons_options_stand_in_its_man_page():
    page = plain(TOP / "systemd/modald.8")
    for option in ("--data", "--bind", "--workers", "--config", "--check-config", "--version"):
        assert option in page


def test_the_configuration_s_keys_stand_in_the_man_page_and_in_the_example_with_one_default():
    """Those of config.c, no more and no fewer."""
    keys = re.findall(r'^    \{ "([a-z_]+)", [A-Z]+,',
                      (TOP / "src/broker/shell/config.c").read_text(), re.M)
    section = plain(TOP / "systemd/modald.8").split(".SH CONFIGURATION")[1].split(".SH ")[0]
    told = dict(re.findall(r'^\.BI ([a-z_]+) " = [^"]+"\n((?:(?!\.TP).*\n)*)', section, re.M))
    example = dict(re.findall(r"^#?([a-z_]+) = *(\S*)$", (TOP / "systemd/modald.conf").read_text(),
                              re.M))
    assert len(keys) > 25 and set(keys) == set(told) == set(example) and len(keys) == len(told)
    for key in keys:
        default = re.search(r"^Default (\S+)\.$", told[key], re.M)
        assert not default or default[1] == example[key], key


def test_the_stream_client_s_page_names_every_call_and_variable():
    page, header = (plain(TOP / "clients/c/modald_stream.3"),
                    (TOP / "clients/c/modald_stream.h").read_text())
    source = (BUILD / "clients/c/modald_stream.c").read_text()
    calls = set(re.findall(r"^(?:modald_stream \*|void |int )(modald_\w+)\(", header, re.M))
    variables = set(re.findall(r'(?:getenv|size_from|number_from|copy_of)\("([A-Z_]+)"',
                               source)) | set(re.findall(r'"(SLURM\w+)"', source))
    assert len(calls) > 12 and len(variables) > 12
    for word in calls | variables:
        assert re.search(rf"\b{word}\b", page), word


@shipped
def test_the_examples_are_built_by_pkg_config_from_what_is_installed(installed, tmp_path):
    examples, lib = installed / "share/doc/modald/examples", library_folder(installed)
    env = {**os.environ, "PKG_CONFIG_PATH": str(lib / "pkgconfig")}
    for name, compiler, package in (("loop.c", "cc", "modald-stream"),
                                    ("identify.c", "cc", "modald-client"),
                                    ("loop.f90", "gfortran", "modald-fortran")):
        if shutil.which(compiler) is None or not (lib / "pkgconfig" / f"{package}.pc").exists():
            continue
        flags = subprocess.run(["pkg-config", "--cflags", "--libs", package], env=env,
                               capture_output=True, text=True, check=True).stdout.split()
        subprocess.run([compiler, str(examples / name), "-o", str(tmp_path / name) + ".out",
                        *flags, "-lm"], check=True, cwd=tmp_path)
        run = subprocess.run([str(tmp_path / name) + ".out", "x", "100"],
                             env=environment(LD_LIBRARY_PATH=lib,
                                             MODALD_URL=f"ipc://{tmp_path}/nobody",
                                             MODALD_SPILL=tmp_path,
                             MODALD_CLOSE_WAIT="0.1"), capture_output=True,
                             stdin=subprocess.DEVNULL)
        assert (run.returncode == (3 if name == "identify.c" else 0)
                and (name == "identify.c" or b"modalctl replay" in run.stderr)), run.stderr


@shipped
def test_the_installed_python_client_finds_the_library_that_was_installed_with_it(installed,
                                                                                  tmp_path):
    package = next(installed.glob("lib/python3*/dist-packages"))
    text = ("import modald\nwith modald.stream('x', 1, 0.1) as s: s.push([[1.0], [2.0]]); "
            "print(s.report.pushed, modald.streaming._load()._name)")
    env = {k: v for k, v in environment(PYTHONPATH=package, MODALD_URL=f"ipc://{tmp_path}/nobody",
                                        MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="0.1").items()
           if k not in ("MODALD_BUILD", "LD_LIBRARY_PATH")}
    done = subprocess.run(["/usr/bin/python3", "-c", text], env=env, capture_output=True,
                          text=True, check=True, cwd=tmp_path)
    assert done.stdout.split() == ["2.0", str(library_folder(installed) / "libmodald-stream.so.0")]


def test_the_example_configuration_is_accepted(tmp_path):
    text = (TOP / "systemd/modald.conf").read_text().replace("/var/lib/modald",
                                                             str(tmp_path / "data")).replace(
        "/run/modald", str(tmp_path))
    (tmp_path / "modald.conf").write_text(text)
    done = subprocess.run([str(BUILD / "bin" / "modald"), "--check-config", "--config",
                           str(tmp_path / "modald.conf")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def in_bash(line):
    words = line.split(" ")
    return f'''source {TOP}/clients/ctl/modalctl.bash
COMP_WORDS=({" ".join(f"'{w}'" for w in words)}); COMP_CWORD={len(words) - 1}; compopt() {{ :; }}
_modalctl; printf '%s\\n' "${{COMPREPLY[@]}}"'''


def in_zsh(line):
    """Its builtins for completion work in its line editor alone: here they say what they are
    given."""
    words = line.split(" ")
    return f'''compadd() {{ [[ $1 == -S ]] && shift 2; [[ $1 == -- ]] && shift
for one in $@; do [[ $one == {words[-1]}* ]] && print -r -- $one; done; true }}
_files() {{ print -r -- FILE }}
words=({" ".join(f"'{w}'" for w in words)}); CURRENT={len(words)}
source {TOP}/clients/ctl/modalctl.zsh'''


def in_fish(line):
    return f"source {TOP}/clients/ctl/modalctl.fish; complete -C '{line}'"


@pytest.fixture(params=[("bash", in_bash), ("zsh", in_zsh), ("fish", in_fish)],
                ids=["bash", "zsh", "fish"])
def complete(request, tmp_path):
    """What a shell offers at the end of a line."""
    shell, script = request.param
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}")

    def offered(line):
        env = environment(PATH=f"{BUILD}/bin:{os.environ['PATH']}", HOME=tmp_path)
        options = {"zsh": ["-f"], "fish": ["--no-config"]}.get(shell, [])
        return subprocess.run([shell, *options, "-c", script(line)], capture_output=True,
                              text=True, env=env, cwd=tmp_path).stdout.split()
    return offered


def test_completion_offers_verbs_kinds_options_and_states(complete):
    assert set(complete("modalctl ")) == set(verbs())
    assert complete("modalctl ident") == ["identify"]
    assert "tradeoff" in complete("modalctl submit ")
    assert set(complete("modalctl list --")) >= {f"--{option}" for option in options("list")}
    assert complete("modalctl list --state qu") == ["queued"]
    assert "rank.fixed=" in complete("modalctl identify a.h5 -o rank.f")
    assert not set(complete("modalctl identify ")) & set(verbs())


@pytest.mark.parametrize("unit", UNITS, ids=lambda p: p.name)
def test_the_unit_is_hardened(unit):
    done = subprocess.run(["systemd-analyze", "security", "--offline=true", "--threshold=15",
                           str(unit)], capture_output=True, text=True)
    overall = re.search(r"Overall exposure level for \S+: ([0-9.]+)", done.stdout)
    assert overall and float(overall.group(1)) <= 1.5, done.stdout[-300:] + done.stderr


def test_the_demo_ends_0_with_both_pairs():
    if not pathlib.Path("/usr/share/sonic-pi/samples/perc_bell.flac").exists():
        pytest.skip("the recording is not installed (Debian package sonic-pi-samples)")
    done = subprocess.run([str(TOP / "clients/demo")], capture_output=True, text=True,
                          env=environment(MODALD_BUILD=BUILD), timeout=300)
    assert done.returncode == 0, done.stderr
    for frequency in ("3615.4", "3620.9", "6738", "6748"):
        assert frequency in done.stdout
    assert "cost:" in done.stdout and "damping ratio" in done.stdout
