"""modalctl fsck, dump and backup on a data folder."""
import contextlib
import fcntl
import glob
import hashlib
import json
import os
import pathlib
import random
import shutil
import sqlite3
import subprocess
import time

import pytest
from wire import PATIENCE_S, Daemon, crc32c, ring_down, submit, until

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).resolve().parents[2]
                                    / "build"))
SCENARIO = BUILD / "fault" / "store_scenario"


def ctl(*arguments):
    done = subprocess.run([BUILD / "bin" / "modalctl", "--json", *arguments], capture_output=True,
                          text=True, timeout=300)
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture
def folder(tmp_path):
    data = tmp_path / "data"
    data.mkdir()
    subprocess.run(["sh", "-c", 'exec "$@" 9>/dev/null', "sh", SCENARIO, "write", data], check=True)
    return data


def test_a_sound_folder_has_no_problems(folder):
    status, [report] = ctl("fsck", str(folder))
    assert (status == 0 and report["problems"] == [] and report["jobs"] == 7
            and "error" not in report)
    assert ctl("fsck", "--data", str(folder)) == (0, [report])


def test_a_flipped_bit_is_named_with_its_file_and_offset(folder):
    sealed = glob.glob(f"{folder}/spool/10.h5")[0]
    content = bytearray(open(sealed, "rb").read())
    content[len(content) // 2] ^= 4
    open(sealed, "wb").write(content)
    status, [report] = ctl("fsck", str(folder))
    assert status == 1 and report["error"]["code"] == "corrupt"
    assert (len(report["problems"]) == 1 and "input 10" in report["problems"][0]
            and "offset" in report["problems"][0])


def test_every_row_is_dumped(folder):
    status, rows = ctl("dump", str(folder))
    jobs = {row["id"]: row for row in rows if row["row"] == "job"}
    assert (status == 0 and len(jobs) == 7 and jobs["5"]["state"] == "dead" and jobs["5"]["key"]
            == "key5")
    assert sorted(row["key"] for row in rows if row["row"] == "tombstone") == ["key1", "key2"]


def test_a_backup_is_sound_and_has_the_same_rows(folder, tmp_path):
    status, [answer] = ctl("backup", str(folder), str(tmp_path / "copy"))
    assert status == 0 and answer["to"] == str(tmp_path / "copy")
    assert ctl("fsck", str(tmp_path / "copy"))[1][0]["problems"] == []
    assert ctl("dump", str(tmp_path / "copy")) == ctl("dump", str(folder))
    status, [answer] = ctl("backup", str(folder), str(tmp_path / "copy"))
    assert status == 2 and answer["error"]["field"] == "to"


def test_a_backup_that_is_killed_is_not_there_and_the_next_one_is_whole(folder, tmp_path):
    """20 kills at random: a folder of the backup's name is sound and complete, always."""
    dice, killed, rows = random.Random(4), 0, ctl("dump", str(folder))
    for i in range(20):
        to = tmp_path / f"copy{i}"
        with subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--json", "backup", str(folder),
                               str(to)], stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL) as run:
            time.sleep(dice.uniform(0.0, 0.03))
            run.kill()
        if not to.exists():
            killed += 1
            assert ctl("backup", str(folder), str(to))[0] == 0
        assert (ctl("fsck", str(to))[0] == 0 and ctl("dump", str(to)) == rows
                and not pathlib.Path(f"{to}.unfinished").exists())
    assert killed > 0


def test_two_backups_to_one_place_are_one_and_a_refusal(folder, tmp_path):
    to = tmp_path / "copy"
    unfinished = pathlib.Path(f"{to}.unfinished")
    unfinished.mkdir()
    held = os.open(unfinished, os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    status, [said] = ctl("backup", str(folder), str(to))
    os.close(held)
    assert status == 4 and said["error"]["code"] == "busy" and not to.exists()
    assert ctl("backup", str(folder), f"{to}/")[0] == 0 and to.exists() and not unfinished.exists()


def live_bytes(data):
    """What the rows of a ledger hold: their texts and blobs, and 8 bytes for each number; and the
    files of the spool."""
    with sqlite3.connect(f"file:{data}/ledger.db?mode=ro", uri=True) as db:
        total = 0
        for (table,) in db.execute(
            "SELECT name FROM sqlite_schema WHERE type = 'table'").fetchall():
            columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            size = " + ".join(f"CASE typeof(\"{c}\") WHEN 'null' THEN 0 WHEN 'integer' THEN 8 WHEN "
                              f"'real' THEN 8 ELSE length(CAST(\"{c}\" AS BLOB)) END"
                              for c in columns)
            total += db.execute(f"SELECT coalesce(sum({size}), 0) FROM {table}").fetchone()[0]
    return total + sum(p.stat().st_size for place in ("spool", "results")
                       for p in (data / place).iterdir())


def test_ledger_and_spool_are_at_most_1_2_of_the_live_bytes_after_retention(tmp_path):
    """Issue 6, line 5, for a small folder too: a second after the last change the log is emptied
    and freed pages are given back."""
    fake = pathlib.Path(__file__).resolve().parent / "fake_worker.py"
    with Daemon(tmp_path,
                config=f"worker_path = {fake}\ninput_age_s = 1\nevents_kept = 1024\n") as d:
        c = d.client()
        jobs = []
        for i in range(300):
            data, described = ring_down(samples=1000, phase=i * 1e-3)
            jobs.append(c.ask("SUBMIT", [data], kind="identify", input=described,
                              options={"document": 3000})["job"])
        for job in jobs:
            assert c.ask("WAIT", job=job, timeout_s=250)["state"] == "done"
        for job in jobs[:200]:
            assert c.ask("DELETE", job=job).ok
        log, end = tmp_path / "data" / "ledger.db-wal", time.monotonic() + PATIENCE_S
        while log.stat().st_size > 0:
            assert time.monotonic() < end, "the log is never emptied"
            time.sleep(0.05)
        used = sum((tmp_path / "data" / name).stat().st_size
                   for name in ("ledger.db", "ledger.db-wal"))
        used += sum(p.stat().st_size for place in ("spool", "results")
                    for p in (tmp_path / "data" / place).iterdir())
        live = live_bytes(tmp_path / "data")
        print(f"\nledger and spool {used} bytes for {live} live ones: {used / live:.3f}")
        assert live > 100 * 8000 and used <= 1.2 * live
        assert c.ask("RESULT", job=jobs[250]).ok


def test_no_folder_and_a_folder_without_a_ledger_are_errors(tmp_path):
    assert ctl("fsck")[0] == 2
    assert ctl("backup", str(tmp_path))[0] == 2
    status, [answer] = ctl("fsck", str(tmp_path))
    assert status == 4 and answer["error"]["code"] == "not_found"


def test_an_answer_from_an_earlier_result_is_sound_though_the_earlier_job_is_deleted(tmp_path):
    fake = pathlib.Path(__file__).parent / "fake_worker.py"
    with Daemon(folder=tmp_path, config=f"worker_path = {fake}\n") as d:
        c = d.client()
        first = submit(c, options={"say": "once"})["job"]
        assert c.ask("WAIT", job=first, timeout_s=250)["state"] == "done"
        assert (submit(c, options={"say": "once"})["cached"] is True
                and c.ask("DELETE", job=first).ok)
        assert d.stop() == 0
    status, [report] = ctl("fsck", str(tmp_path / "data"))
    assert status == 0 and report["problems"] == [] and report["jobs"] == 2


def open_to_others(folder):
    return {str(path): oct(path.lstat().st_mode & 0o777)
            for path in sorted(pathlib.Path(folder).rglob("*"))
            if path.lstat().st_mode & 0o027 and path.is_file()}


def test_no_file_of_the_daemon_is_open_to_others_whatever_the_umask_and_an_open_folder_is_warned_of(
        tmp_path):
    """A data folder that was there with mode 0755, a daemon with umask 0, kill -9 so that log and
    index of the ledger stay."""
    data, metrics = tmp_path / "data", tmp_path / "metrics.prom"
    data.mkdir()
    data.chmod(0o755)
    with Daemon(folder=tmp_path, config=f"metrics_file = {metrics}\nmetrics_s = 0.1\n",
                wrap=["sh", "-c", 'umask 0; exec "$@"', "sh"]) as daemon:
        client = daemon.client()
        client.ask("WAIT", job=submit(client)["job"], timeout_s=250)
        batch = bytes(8 * 9000)
        upload = client.ask("UPLOAD", op="begin", content="batch", samples=9000, channels=1,
                            dt=0.1)["upload"]
        client.ask("UPLOAD", [batch], op="chunk", upload=upload, offset=0, crc32c=crc32c(batch))
        stream = client.ask("STREAM", op="open", name="st", channels=1, dt=0.1)["stream"]
        assert client.ask("STREAM", [bytes(80)], op="push", stream=stream, epoch=0, first=0,
                          count=10, crc32c=crc32c(bytes(80))).ok
        assert ctl("backup", str(data), str(tmp_path / "copy"))[0] == 0
        until(metrics.exists, "there are no metrics")
        assert oct(metrics.stat().st_mode & 0o777) == "0o640"
        assert {"ledger.db", "ledger.db-wal", "ledger.db-shm", "2.part",
                "tape"} <= {path.name for path in data.rglob("*")}
        assert open_to_others(data) == {} and open_to_others(tmp_path / "copy") == {}
        assert [line for line in daemon.text().splitlines() if "event=data_open" in line
                and "mode=0755" in line and str(data) in line]


def test_a_ledger_that_an_earlier_version_made_for_all_to_read_is_closed_to_them(tmp_path):
    data = tmp_path / "data"
    with Daemon(folder=tmp_path) as daemon:
        submit(daemon.client())
        daemon.kill()
        for name in ("ledger.db", "ledger.db-wal", "ledger.db-shm"):
            (data / name).chmod(0o644)
        daemon.start()
        assert open_to_others(data) == {} and "event=data_open" not in daemon.text()


def test_what_hello_and_the_host_tell_of_a_store_is_not_the_id_that_numbers_its_jobs(tmp_path):
    """Identifiers are mixed by a hash of the ledger's id: who has the id can number his jobs, and
    so count others'."""
    with Daemon(folder=tmp_path, workers=0) as daemon:
        told = daemon.client().ask("HELLO")["store"]
        names = pathlib.Path("/proc/net/unix").read_text()
        assert daemon.stop() == 0
        for file in (tmp_path / "data").glob("ledger.db*"):
            shutil.copy(file, tmp_path)
        with contextlib.closing(sqlite3.connect(tmp_path / "ledger.db")) as ledger:
            [[own]] = ledger.execute("SELECT value FROM about WHERE name='store'")
        assert len(own) == len(told) == 32 and own != told and own not in names
        assert hashlib.sha256(own.encode()).hexdigest()[:32] != told
        daemon.start()
        assert daemon.client().ask("HELLO")["store"] == told


def test_an_upload_under_way_is_no_damage(tmp_path):
    with Daemon(folder=tmp_path, workers=0) as daemon:
        client, part = daemon.client(), bytes(range(256)) * 16
        upload = client.ask("UPLOAD", op="begin", content="batch", samples=1024, channels=1,
                            dt=0.1)["upload"]
        assert client.ask("UPLOAD", [part], op="chunk", upload=upload, offset=0,
                          crc32c=crc32c(part)).ok
        status, [report] = ctl("fsck", str(tmp_path / "data"))
        assert (status, report["problems"], report["chunks"]) == (0, [], 1)
        file = next((tmp_path / "data" / "spool").glob("*.part"))
        file.write_bytes(file.read_bytes().replace(part[:300], part[1:301]))
        status, [report] = ctl("fsck", str(tmp_path / "data"))
        assert (status == 1 and len(report["problems"]) == 1
                and "chunk at 0" in report["problems"][0])


@pytest.mark.parametrize("how", ["removed", "moved", "put back"])
def test_nothing_is_acknowledged_once_the_data_folder_is_gone(tmp_path, how):
    """What is committed then is in files that have no name, or another's."""
    with Daemon(folder=tmp_path, workers=0) as d:
        client = d.client()
        assert submit(client, "before").ok
        folder = d.folder / "data"
        if how == "removed":
            shutil.rmtree(folder)
        else:
            shutil.move(folder, tmp_path / "elsewhere")
        if how == "put back":
            shutil.copytree(tmp_path / "elsewhere", folder,
                            ignore=shutil.ignore_patterns("*.ipc"))
        data, described = ring_down()
        client.send("SUBMIT", [data], kind="identify", options={}, key="after", input=described)
        assert d.process.wait(300) == 1
        assert client.socket.poll(0) == 0


@pytest.mark.parametrize("name, says", [("ledger.db-wal", "code=corrupt"),
                                        ("ledger.db-shm", "code=io")])
def test_nothing_is_acknowledged_once_a_file_of_the_ledger_is_cut_under_the_daemon(tmp_path, name,
                                                                                   says):
    """Of the log, groups that were acknowledged are lost; of its index nothing is."""
    acknowledged, data, described = [], *ring_down()
    with Daemon(folder=tmp_path, workers=0) as d:
        client = d.client()
        for k in range(1000):               # at rest the log is empty, and a cut takes nothing
            client.send("SUBMIT", [data], kind="identify", options={}, key=f"k{k}",
                        input=described)
            until(lambda: client.socket.poll(50) or d.process.poll() is not None)
            if not client.socket.poll(0):
                break
            assert client.answer(client.number).ok
            acknowledged.append(f"k{k}")
            os.truncate(d.folder / "data" / name, 0)
        assert d.process.wait(300) == 1 and acknowledged
        assert [line for line in d.text().splitlines()
                if says in line and name in line and "made shorter" in line]
        if name.endswith("wal"):
            d.start(ready=False)
            assert d.process.wait(300) == 1 and "acknowledged" in d.text()
        else:
            d.start()
            client = d.client()
            assert all(client.ask("STATUS", job=f"key:{key}").ok for key in acknowledged)
