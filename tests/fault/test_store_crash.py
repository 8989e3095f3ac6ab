"""F1, F3, F4, F5, F6, F7 at the store: a fixed life (store_scenario.c) broken in every way, then
recovered and checked.

Each test prints a line for each promise: states tried, violations.
"""
import collections
import hashlib
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile

import pytest

import crashgen
from small_disk import small_disk

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).resolve().parents[2]
                                    / "build"))
SCENARIO = BUILD / "fault" / "store_scenario"
CRASHIO = BUILD / "fault" / "libcrashio.so"
VARIANTS = int(os.environ.get("MODALD_CRASH_VARIANTS", "20"))
CALLS = ["open", "pread", "pwrite", "fsync", "fdatasync", "ftruncate", "fallocate", "rename",
         "unlink", "mkdir"]
PROMISES = {"P1": "acknowledged is durable", "P2": "one key, one job",
            "P3": "states move by the table", "P5": "data are bit for bit, or reported"}


@pytest.fixture
def scratch():
    base = "/dev/shm" if os.path.isdir("/dev/shm") and os.access("/dev/shm", os.W_OK) else None
    folder = tempfile.mkdtemp(prefix="modald-test-", dir=base)
    yield folder
    shutil.rmtree(folder)


def write(folder, acks, *wrapper, preload=None, **environment):
    """One life of the store in FOLDER; (exit status or -signal, stderr).  Acknowledgements go to
    the file ACKS.
    """
    os.makedirs(folder, exist_ok=True)
    if preload:       # only the scenario itself is recorded
        wrapper = (*wrapper, "env", f"LD_PRELOAD={preload}")
    done = subprocess.run(["sh", "-c", 'acks=$1; shift; exec "$@" 9>"$acks"', "sh", acks, *wrapper,
                           SCENARIO, "write", folder],
                          env={**os.environ, **environment}, stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, timeout=300)
    return done.returncode, done.stderr.decode()


class Checker:
    """A process that recovers folders and says what is wrong; counts for the promises' lines."""

    def __init__(self):
        self.process = subprocess.Popen([SCENARIO, "check"], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        self.tried, self.violations = 0, collections.defaultdict(list)

    def check(self, folder, acks, what):
        self.process.stdin.write(f"{folder} {acks}\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().strip()
        self.tried += 1
        if answer != "ok":
            self.violations[answer[:2] if answer[:2] in PROMISES else "P5"].append(
                f"{what}: {answer or 'the check died'}")
        return answer

    def close(self, name):
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()
        for promise, text in PROMISES.items():
            print(f"{promise} ({text}), {name}: states {self.tried}, violations "
                  f"{len(self.violations[promise])}")
        found = [line for lines in self.violations.values() for line in lines]
        assert not found, "\n".join(found[:10])


def lay(folder, state):
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    for name in sorted(state):
        if state[name] == "dir":
            os.makedirs(f"{folder}/{name}", exist_ok=True)
    for name, content in state.items():
        if content != "dir":
            with open(f"{folder}/{name}", "wb") as file:
                file.write(content)


def recorded(scratch):
    folder, log, acks = f"{scratch}/life", f"{scratch}/log", f"{scratch}/acks"
    os.makedirs(folder)
    status, errors = write(folder, acks, preload=CRASHIO, CRASHIO_DIR=folder, CRASHIO_LOG=log)
    assert status == 0, errors
    return crashgen.read_log(log), open(acks).read().splitlines(keepends=True)


def first_acks(scratch, lines, count):
    path = f"{scratch}/acks-{count}"
    if not os.path.exists(path):
        with open(path, "w") as file:
            file.writelines(lines[:count])
    return path


def test_a_power_cut_anywhere_loses_nothing_that_was_acknowledged(scratch, capsys):
    log, lines = recorded(scratch)
    checker, seen = Checker(), set()
    for number, (acks, state) in enumerate(crashgen.states(log,
                                                           int(os.environ.get("MODALD_SEED",
                                                                              "2385")), VARIANTS)):
        digest = hashlib.sha1(
            repr(sorted((k, hashlib.sha1(v.encode() if v == "dir" else v).digest())
                        for k, v in state.items())).encode() + bytes([acks])).digest()
        if digest in seen:
            continue
        seen.add(digest)
        lay(f"{scratch}/state", state)
        if (checker.check(f"{scratch}/state", first_acks(scratch, lines, acks), f"state {number}")
            != "ok" and "MODALD_KEEP" in os.environ):
            lay(os.environ["MODALD_KEEP"], state)
            shutil.copy(first_acks(scratch, lines, acks), os.environ["MODALD_KEEP"] + ".acks")
            break
    with capsys.disabled():
        print()
        checker.close("power cuts")
    assert checker.tried > 400 + 50 * VARIANTS


def test_the_generator_finds_a_store_that_does_not_sync(scratch):
    """The same, with every sync of a file taken out of the record, must fail: else the test above
    could not.
    """
    log, lines = recorded(scratch)
    checker = Checker()
    for acks, state in crashgen.states([entry for entry in log if entry[0] != "s"], 1, 1):
        if acks > 5 and not checker.violations:
            lay(f"{scratch}/state", state)
            checker.check(f"{scratch}/state", first_acks(scratch, lines, acks), "")
    checker.process.stdin.close()
    checker.process.wait()
    checker.process.stdout.close()
    assert checker.violations["P1"] or checker.violations["P5"]


def calls_of_a_life(scratch):
    """How often each call of file.h is made, by failing at the n-th until a run passes (a search,
    not a sweep).
    """
    counts = {}
    for call in CALLS + ["any"]:
        low, high = 0, 1 << 14
        while high - low > 1:
            middle = (low + high) // 2
            status, _ = write(f"{scratch}/count", f"{scratch}/count.acks",
                              MODALD_FAULT=f"{call}:{middle}:kill")
            shutil.rmtree(f"{scratch}/count")
            low, high = (middle, high) if status == -signal.SIGKILL else (low, middle)
        counts[call] = low
    return counts


def sweep(scratch, checker, call, count, what, step, judge):
    for n in range(1, count + 1, step):
        folder, acks = f"{scratch}/life", f"{scratch}/acks"
        status, errors = write(folder, acks, MODALD_FAULT=f"{call}:{n}:{what}")
        where = f"{call}:{n}:{what}"
        wrong = judge(status, open(acks).read())
        if wrong:
            checker.violations["P1"].append(f"{where}: {wrong}; {errors.strip()}")
        checker.check(folder, acks, where)
        shutil.rmtree(folder)


def test_every_call_can_be_the_last_or_fail(scratch, capsys):
    """kill before and after each call (F1); EIO ends the process (F5, P7); ENOSPC refuses and goes
    on (F7, P8); EINTR and short transfers change nothing (F6).
    """
    status, _ = write(f"{scratch}/good", f"{scratch}/good.acks")
    good, counts = open(f"{scratch}/good.acks").read(), calls_of_a_life(scratch)
    assert status == 0 and counts["pwrite"] > 100 and counts["fdatasync"] > 20
    step = int(os.environ.get("MODALD_FAULT_STEP", "1"))
    killed = {"kill": lambda status, acks: None if status == -signal.SIGKILL
              else f"status {status}, not killed"}
    ended = (lambda status, acks: None if status in (3, 4)
             else f"status {status}: a failed sync did not end the process")
    lived = (lambda status, acks: None if status in (0, 4)
             else f"status {status}: a full disk ended the process")
    same = (lambda status, acks: None if status == 0 and acks == good
            else f"status {status}: not as if nothing had happened")
    anyhow = lambda status, acks: None if status in (0, 3, 4) else f"status {status}"
    plan = [("kill points",
             [("any", "kill", 1, killed["kill"]), ("any", "kill-after", 7, killed["kill"])]),
            ("failed syncs", [("fdatasync", "EIO", 1, ended), ("fsync", "EIO", 1, ended),
                              ("fdatasync", "ENOSPC", 5, ended)]),
            ("failed calls", [(call, "EIO", 1 if call == "pread" else 3, anyhow) for call in CALLS
                              if "sync" not in call]),
            ("full disk", [("pwrite", "ENOSPC", 1, lived), ("fallocate", "ENOSPC", 1, lived)]),
            ("interrupted and short calls",
             [("any", "EINTR", 11, same), ("pwrite", "short", 5, same),
              ("pread", "short", 9, same)])]
    with capsys.disabled():
        print()
        for name, sweeps in plan:
            checker = Checker()
            for call, what, stride, judge in sweeps:
                sweep(scratch, checker, call, counts[call], what, stride * step, judge)
            checker.close(name)


@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_killed_at_the_nth_system_call_of_each_kind(scratch, capsys):
    """F1 without our own fault points: strace ends it."""
    if subprocess.run(["strace", "-qq", "-o", "/dev/null", "true"],
                      stderr=subprocess.DEVNULL).returncode != 0:
        pytest.skip("strace may not trace here")
    if b"__asan_init" in SCENARIO.read_bytes():
        pytest.skip("the leak checker does not run under strace")
    checker, points = Checker(), 0
    for call in ("write", "pwrite64", "fdatasync", "fsync", "ftruncate", "rename", "unlink"):
        n, step = 1, 1
        while True:
            folder, acks = f"{scratch}/life", f"{scratch}/acks"
            status, _ = write(folder, acks, "strace", "-f", "-qq", "-o", "/dev/null", "-e",
                              f"trace={call}", "-e", f"inject={call}:signal=SIGKILL:when={n}")
            checker.check(folder, acks, f"{call} {n}")
            shutil.rmtree(folder)
            if status == 0:
                break
            points += 1
            n, step = n + step, step + (n > 8)
    with capsys.disabled():
        print()
        checker.close(f"strace kills at {points} calls")
    assert points > 50


SILENT = ("is lost", "is not what", "another identity", "was ", "there twice",
          "was never submitted", "acknowledged were")


def damaged(scratch, lines, acks, state, checker, name, content, tolerated, what):
    """STATE with file NAME holding CONTENT: whatever is wrong must be reported, or be the loss of
    what TOLERATED says.
    """
    lay(f"{scratch}/state", {**state, name: content})
    answer = checker.check(f"{scratch}/state", first_acks(scratch, lines, acks), what)
    if answer == "ok" or not any(text in answer for text in SILENT):
        if answer != "ok":
            forgive(checker)
        return
    for fewer in range(1, tolerated + 1):
        lay(f"{scratch}/state", {**state, name: content})
        forgive(checker)
        answer = checker.check(f"{scratch}/state",
                               first_acks(scratch, lines, max(acks - fewer, 0)), what)
        if answer == "ok":
            return


def forgive(checker):
    for lines in checker.violations.values():
        if lines:
            lines.pop()


def living_state(log):
    """The disk in the middle of a life: a database, a log of several groups, a sealed and an open
    upload, a large result, two open streams.
    """
    prefix, seen = [], 0
    for entry in log:
        seen += entry[0] == "a"
        prefix.append(entry)
        if seen == 34:
            return crashgen.whole(prefix)
    raise AssertionError("the life is shorter than it was")


def test_flipped_bits_and_zeroed_pages_are_reported(scratch, capsys):
    log, lines = recorded(scratch)
    acks, state = living_state(log)
    checker = Checker()
    assert (len(state["ledger.db-wal"]) > 20000 and any(name.endswith(".h5") for name in state)
            and any(name.startswith("results/") for name in state))
    assert {"spool/20.samples", "spool/21.samples"} <= set(state)
    for name, content in state.items():
        if content == "dir" or name in ("LOCK", "RESERVE") or not content:
            continue
        step = max(len(content) // 150, 1)
        for at in range(0, len(content), step):
            flipped = bytearray(content)
            flipped[at] ^= 1 << at % 8
            damaged(scratch, lines, acks, state, checker, name, bytes(flipped), 0,
                    f"{name} bit {at % 8} of byte {at}")
        for at in range(0, len(content) - 4095, 4096):
            page = content[:at] + bytes(4096) + content[at + 4096:]
            damaged(scratch, lines, acks, state, checker, name, page, 0, f"{name} zeros at {at}")
    with capsys.disabled():
        print()
        checker.close("flipped bits, zeroed pages")


def test_truncation_is_reported_or_an_earlier_state(scratch, capsys):
    log, lines = recorded(scratch)
    acks, state = living_state(log)
    checker = Checker()
    for name, content in state.items():
        if content == "dir" or name in ("LOCK", "RESERVE") or not content:
            continue
        tail = range(len(content) - 1, max(len(content) - 9000, 0), -61)
        for length in [*tail, *range(0, len(content), max(len(content) // 40, 1))]:
            damaged(scratch, lines, acks, state, checker, name, content[:length], acks,
                    f"{name} cut to {length}")
    with capsys.disabled():
        print()
        checker.close("truncations")


def test_a_disk_that_is_really_full_refuses_and_recovers(scratch, capsys):
    """F7 on a small tmpfs: bytes, then inodes; more room afterwards, and everything acknowledged is
    there.
    """
    checker = Checker()
    for option in [f"size={kilobytes}k" for kilobytes in range(60, 900,
                                                               24)] + [f"size=9m,nr_inodes={count}"
                                                                       for count in range(5, 18)]:
        with small_disk(option) as disk:
            status, errors = write(f"{disk}/life", f"{scratch}/acks")
            if status not in (0, 4):
                checker.violations["P1"].append(
                    f"{option}: status {status}: {errors.strip()[-200:]}")
            subprocess.run(["mount", "-o", "remount,size=20m,nr_inodes=1000", disk], check=True)
            checker.check(f"{disk}/life", f"{scratch}/acks", option)
    with capsys.disabled():
        print()
        checker.close("small disks")
