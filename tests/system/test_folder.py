"""modalctl fsck, dump and backup on a data folder."""
import glob
import json
import os
import pathlib
import subprocess

import pytest
from wire import Daemon, submit

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).resolve().parents[2] / "build"))
SCENARIO = BUILD / "fault" / "store_scenario"


def ctl(*arguments):
    done = subprocess.run([BUILD / "bin" / "modalctl", "--json", *arguments], capture_output=True, text=True, timeout=60)
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture
def folder(tmp_path):
    data = tmp_path / "data"
    data.mkdir()
    subprocess.run(["sh", "-c", 'exec "$@" 9>/dev/null', "sh", SCENARIO, "write", data], check=True)
    return data


def test_a_sound_folder_has_no_problems(folder):
    status, [report] = ctl("fsck", str(folder))
    assert status == 0 and report["problems"] == [] and report["jobs"] == 7 and "error" not in report
    assert ctl("fsck", "--data", str(folder)) == (0, [report])


def test_a_flipped_bit_is_named_with_its_file_and_offset(folder):
    sealed = glob.glob(f"{folder}/spool/10.h5")[0]
    content = bytearray(open(sealed, "rb").read())
    content[len(content) // 2] ^= 4
    open(sealed, "wb").write(content)
    status, [report] = ctl("fsck", str(folder))
    assert status == 1 and report["error"]["code"] == "corrupt"
    assert len(report["problems"]) == 1 and "input 10" in report["problems"][0] and "offset" in report["problems"][0]


def test_every_row_is_dumped(folder):
    status, rows = ctl("dump", str(folder))
    jobs = {row["id"]: row for row in rows if row["row"] == "job"}
    assert status == 0 and len(jobs) == 7 and jobs["5"]["state"] == "dead" and jobs["5"]["key"] == "key5"
    assert sorted(row["key"] for row in rows if row["row"] == "tombstone") == ["key1", "key2"]


def test_a_backup_is_sound_and_has_the_same_rows(folder, tmp_path):
    status, [answer] = ctl("backup", str(folder), str(tmp_path / "copy"))
    assert status == 0 and answer["to"] == str(tmp_path / "copy")
    assert ctl("fsck", str(tmp_path / "copy"))[1][0]["problems"] == []
    assert ctl("dump", str(tmp_path / "copy")) == ctl("dump", str(folder))
    status, [answer] = ctl("backup", str(folder), str(tmp_path / "copy"))
    assert status == 2 and answer["error"]["field"] == "to"


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
        assert c.ask("WAIT", job=first, timeout_s=15)["state"] == "done"
        assert submit(c, options={"say": "once"})["cached"] is True and c.ask("DELETE", job=first).ok
        assert d.stop() == 0
    status, [report] = ctl("fsck", str(tmp_path / "data"))
    assert status == 0 and report["problems"] == [] and report["jobs"] == 2
