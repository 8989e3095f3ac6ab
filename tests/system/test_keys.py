"""Keys, roles, shares and limits (PROTOCOL.md, section 12): who may what, who sees what, who waits how long."""
import json
import pathlib
import time

import pytest
import zmq

from lab import Lab
from wire import Client, ring_down, submit

pytestmark = pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")


@pytest.fixture()
def lab(tmp_path):
    made = []

    def make(users, **options):
        made.append(Lab(tmp_path, users, **options))
        return made[-1]
    yield make
    for one in made:
        one.daemon.__exit__()


def silent(client):
    try:
        client.ask("HELLO")
        return False
    except zmq.Again:
        return True
    finally:
        client.close()


def test_a_key_is_a_user_with_a_role(lab):
    it = lab({"ann": "ann submit", "ben": "ben read", "eva": "eva admin"})
    for name, role in (("ann", "submit"), ("ben", "read"), ("eva", "admin")):
        who = it.client(name).ask("WHOAMI")
        assert (who["user"], who["role"]) == (name, role)


def test_wrong_missing_and_foreign_keys_get_no_answer(lab):
    it = lab({"ann": "ann submit"})
    assert silent(it.client("ann", timeout_s=0.7, pair=zmq.curve_keypair()))
    assert silent(it.client("ann", timeout_s=0.7, server=zmq.curve_keypair()[0]))
    assert silent(Client(it.daemon.endpoint, timeout_s=0.7))
    assert it.client("ann").ask("HELLO").ok


def test_a_role_may_do_what_its_row_says_and_no_more(lab):
    it = lab({"ann": "ann submit", "ben": "ben read", "eva": "eva admin", "wes": "wes worker"})
    assert submit(it.client("ben")).code == "denied"
    assert it.client("ben").ask("LIST").ok
    assert it.client("ann").ask("DRAIN").code == "denied"
    assert it.client("eva").ask("DRAIN").ok and it.client("eva").ask("UNDRAIN").ok
    assert it.client("wes").ask("LIST").code == "denied"


def test_no_user_can_tell_whether_anothers_job_exists(lab):
    it = lab({"ann": "ann submit", "ben": "ben submit", "eva": "eva admin"})
    ann, ben = it.client("ann"), it.client("ben")
    job = submit(ann, key="mine")["job"]
    assert ann.ask("WAIT", job=job, timeout_s=15)["state"] == "done"
    for verb in ("STATUS", "WAIT", "RESULT", "CANCEL", "RETRY", "DELETE"):
        theirs, nobodys = ben.ask(verb, job=job), ben.ask(verb, job="00000000")
        assert theirs.header["error"] == nobodys.header["error"]
        assert ben.ask(verb, job="key:mine").header["error"] == ben.ask(verb, job="key:none").header["error"]
    assert json.loads(ben.ask("LIST").body[0])["jobs"] == []
    sha = ann.ask("UPLOAD", op="begin", content="batch", samples=9, channels=1, dt=1)["upload"]
    assert ben.ask("UPLOAD", op="abort", upload=sha).code == "not_found"
    same = submit(ben, key="mine")
    assert same["job"] != job and same["duplicate"] is False and "cached" not in same.header
    ben.ask("EVENTS", **{"from": 1})
    ben.ask("WAIT", job=same["job"], timeout_s=15)
    assert all(e["job"] == same["job"] for e in ben.early if e.verb == "EVENT")


def test_a_revoked_key_is_denied_from_the_reload_on(lab):
    it = lab({"ann": "ann submit", "ben": "ben submit"})
    ann, ben = it.client("ann"), it.client("ben")
    assert ann.ask("HELLO").ok and ben.ask("HELLO").ok
    it.write_keys(leave_out=("ben",))
    it.reload()
    assert ben.ask("HELLO").code == "denied"
    assert ann.ask("HELLO").ok
    assert silent(it.client("ben", timeout_s=0.7))


@pytest.mark.parametrize("file", ["server.key", "keys"])
def test_a_key_file_that_others_can_read_is_refused(lab, file, tmp_path):
    it = lab({"ann": "ann submit"})
    assert it.daemon.stop() == 0
    (tmp_path / file).chmod(0o644)
    with pytest.raises(RuntimeError, match="0600"):
        it.daemon.start()


def test_limits_answer_quota_exactly_with_what_is_used(lab):
    it = lab({"ann": "ann submit queued=3 bytes=100k"})
    c = it.client("ann")
    submit(c, options={"sleep": 5})
    end = time.monotonic() + 10
    while c.ask("WHOAMI")["used"]["running"] < 1:
        assert time.monotonic() < end
    codes = [submit(c, options={"say": f"q{i}"}) for i in range(5)]
    assert [r.code for r in codes] == [None, None, None, "quota", "quota"]
    detail = codes[-1]["error"]["detail"]
    assert (detail["limit"], detail["most"], detail["used"]) == ("queued", 3, 3) and detail["retry_after_s"] > 0
    data, described = ring_down()
    reply = c.ask("SUBMITS", [2 * data], jobs=[{"kind": "identify", "input": described, "options": {"say": f"q{i}"}} for i in (7, 8)])
    assert [a["error"]["code"] for a in json.loads(reply.body[0])["jobs"]] == ["quota", "quota"]
    big = c.ask("UPLOAD", op="begin", content="batch", samples=12801, channels=1, dt=1)
    assert big.code == "quota" and big["error"]["detail"]["limit"] == "bytes" and big["error"]["detail"]["most"] == 102400


def test_cpu_seconds_of_the_day_are_counted_on_over_a_restart_and_a_delete(lab):
    """The stand-in worker says that each job took 0.01 s of CPU."""
    it = lab({"ann": "ann submit cpu_s_day=0.025"})
    before = time.gmtime().tm_yday
    c = it.client("ann")
    for i in range(2):
        job = submit(c, options={"say": f"r{i}"})["job"]
        assert c.ask("WAIT", job=job, timeout_s=15)["state"] == "done"
    assert c.ask("DELETE", job=job).ok
    it.daemon.stop()
    it.daemon.start()
    c = it.client("ann")
    used = c.ask("WHOAMI")["used"]["cpu_s_day"]
    job = submit(c, options={"say": "r2"})["job"]
    assert c.ask("WAIT", job=job, timeout_s=15)["state"] == "done"
    refused = submit(c, options={"say": "r3"})
    if time.gmtime().tm_yday == before:                # at midnight the count begins anew, rightly
        assert abs(used - 0.02) < 1e-9
        assert refused.code == "quota" and refused["error"]["detail"]["limit"] == "cpu_s_day"


def test_a_user_with_10_jobs_waits_no_longer_than_his_fair_share(lab):
    """One queues 10,000 jobs, then another 10: with equal weights the 10 are done when about 20 of all have run since."""
    it = lab({"ann": "ann submit", "ben": "ben submit"})
    ann, ben = it.client("ann", timeout_s=60), it.client("ben", timeout_s=60)
    data, described = ring_down()
    for first in range(0, 10000, 500):                # pipelined: as many as may wait for an answer on one connection
        asked = [ann.send("SUBMIT", [data], kind="identify", options={"sleep": 0.01, "say": f"a{i}"}, input=described) for i in range(first, first + 500)]
        assert all(ann.answer(number).ok for number in asked)
    mine = [submit(ben, options={"sleep": 0.01, "say": f"b{i}"})["job"] for i in range(10)]
    before, begin = ann.ask("STATS")["jobs"]["done"], time.monotonic()
    for job in mine:
        assert ben.ask("WAIT", job=job, timeout_s=60)["state"] == "done"
    meanwhile = ann.ask("STATS")["jobs"]["done"] - before - 10
    print(f"\nfair share: 10 jobs of the second user done after {time.monotonic() - begin:.2f} s, while the first had {meanwhile} of his 10000")
    assert meanwhile <= 25                            # 10 by the shares, and what one quantum and the waiting let through


def test_drain_and_denial_are_in_the_audit_log_and_no_secret_is(lab):
    it = lab({"ann": "ann submit", "eva": "eva admin"})
    it.client("eva").ask("DRAIN")
    it.client("ann").ask("DRAIN")
    text = it.daemon.text()
    assert "event=audit user=eva what=drain" in text and "event=audit user=ann what=denied verb=DRAIN" in text
    secrets = [it.server[1].decode()] + [pair[1].decode() for pair in it.pairs.values()]
    environment = pathlib.Path(f"/proc/{it.daemon.pid}/environ").read_text() + pathlib.Path(f"/proc/{it.daemon.pid}/cmdline").read_text()
    assert not any(s in text or s in environment for s in secrets)
