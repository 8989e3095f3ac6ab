"""Alerts and dashboard for operators: their queries are asked of a real Prometheus that scrapes a
busy daemon by its page.
"""
import json
import re
import shutil
import signal
import socket
import subprocess
import urllib.error
import urllib.parse
import urllib.request

import pytest

from conftest import TOP
from test_page import BATCH, PROGRAM, Page, submit_some
from wire import PATIENCE_S, until

pytestmark = [
    pytest.mark.skipif(not PROGRAM.exists(), reason="modald-web is not built: no libmicrohttpd"),
    pytest.mark.skipif(shutil.which("prometheus") is None or shutil.which("promtool") is None,
                       reason="prometheus is not installed")]
FOLDER = TOP / "systemd" / "prometheus"
RULES = FOLDER / "modald.rules.yml"
DASHBOARD = json.loads((FOLDER / "modald-grafana.json").read_text())
QUERIES = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]


@pytest.fixture(scope="module")
def page(daemon, tmp_path_factory):
    made = Page(tmp_path_factory.mktemp("page"), daemon.endpoint).ready()
    yield made
    made.close()


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Prometheus:
    """One of this test's own, that scrapes PAGE five times a second."""

    def __init__(self, folder, page):
        self.port = free_port()
        (folder / "prometheus.yml").write_text(
            "global: {scrape_interval: 200ms, scrape_timeout: 200ms, evaluation_interval: 200ms}\n"
            f"rule_files: ['{RULES}']\n"
            "scrape_configs:\n"
            f"  - {{job_name: modald, static_configs: [{{targets: ['127.0.0.1:{page.port}']}}]}}\n")
        self.log = folder / "log"
        with open(self.log, "w", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                ["prometheus", f"--config.file={folder}/prometheus.yml",
                 f"--storage.tsdb.path={folder}/data",
                 f"--web.listen-address=127.0.0.1:{self.port}"], stderr=log, stdout=log)
        until(self.is_ready, "prometheus does not start")

    def is_ready(self):
        assert self.process.poll() is None, self.log.read_text()[-2000:]
        try:
            return self.get("/-/ready") is not None
        except OSError:
            return False

    def get(self, path):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}",
                                    timeout=PATIENCE_S) as answer:
            return answer.read().decode()

    def query(self, expression):
        answer = json.loads(self.get("/api/v1/query?" + urllib.parse.urlencode(
            {"query": expression})))
        assert answer["status"] == "success", answer
        return answer["data"]["result"]

    def close(self):
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(PATIENCE_S)


@pytest.fixture(scope="module")
def prometheus(page, daemon, tmp_path_factory):
    with daemon.client() as client:
        client.submit("identify", BATCH).result()
    made = Prometheus(tmp_path_factory.mktemp("prometheus"), page)
    yield made
    made.close()


def test_the_rules_are_accepted_by_promtool():
    done = subprocess.run(["promtool", "check", "rules", str(RULES)], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0 and "SUCCESS" in done.stdout, done.stdout + done.stderr


def test_the_metrics_are_accepted_by_promtool(page):
    done = subprocess.run(["promtool", "check", "metrics"], input=page.get("/metrics").text,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_query_of_the_dashboard_has_an_answer(prometheus, daemon):
    """Rates need two scrapes with a change between."""
    assert len(QUERIES) > 12
    submit_some(daemon, [f"scraped{i}" for i in range(5)])
    for query in QUERIES:
        until(lambda q=query: prometheus.query(q), f"no data for {query}")


def test_every_metric_that_a_rule_names_is_told_and_no_alert_fires(prometheus, page):
    text = RULES.read_text()
    named = set(re.findall(r"\bmodald_\w+", "\n".join(re.findall(r"expr: (.*)", text))))
    told = page.get("/metrics").text
    assert len(named) > 8
    for name in named:
        assert re.search(rf"^{name}[ {{]", told, re.M), name
    until(lambda: prometheus.query('up{job="modald"} == 1'))
    groups = json.loads(prometheus.get("/api/v1/rules"))["data"]["groups"]
    rules = [rule for group in groups for rule in group["rules"]]
    assert len(rules) == len(re.findall(r"alert:", text))
    until(lambda: all(rule["health"] == "ok" for group in json.loads(prometheus.get(
        "/api/v1/rules"))["data"]["groups"] for rule in group["rules"]))
    assert not [rule["name"] for rule in rules if rule["state"] == "firing"]
