"""`modalctl watch STREAM`: trend, lag and gaps beside the modes, as lines, as JSON and as
Prometheus text (streaming.md, section 5, requirement 10)."""
import contextlib
import json
import re
import subprocess
import threading

import numpy as np
import pytest
import wire
from conftest import BUILD, PATIENCE, environment, watched, write_batch
from wire import Daemon, crc32c

WINDOW, DT, HZ = 200, 0.1, 0.5


def gauges(path):
    """Prometheus text as {(name, mode or None): value}; every sample's name has its TYPE before
    it."""
    out, typed = {}, set()
    for line in path.read_text().splitlines():
        if line.startswith("# TYPE "):
            typed.add(line.split()[2])
        if line.startswith("#"):
            continue
        name, labels, value = re.fullmatch(r"(\w+)\{([^}]*)\} (\S+)", line).groups()
        labels = dict(re.findall(r'(\w+)="([^"]*)"', labels))
        assert name in typed and labels.pop("stream") == "changing"
        out[name.removeprefix("modald_stream_"), labels.get("mode")] = float(value)
    return out


@pytest.fixture(scope="module")
def changing():
    """A daemon that has seen 0.5 Hz with zeta 0.02 for three windows, then 0.005, noise 1e-5; a gap
    of 50 samples before the fifth."""
    rng, t, first = np.random.default_rng(3), DT * np.arange(WINDOW), 0
    with Daemon(workers=1) as d:
        c = d.client()
        c.ask("EVENTS", stream="changing")
        s = c.ask("STREAM", op="open", name="changing", channels=1, dt=DT,
                  window={"samples": WINDOW, "hop": WINDOW, "options": {"rank.fixed": 2}})["stream"]
        for k in range(5):
            zeta, w = (0.02 if k < 3 else 0.005), 2 * np.pi * HZ
            y = np.exp(-zeta * w * t) * np.cos(w * np.sqrt(1 - zeta**2)
                                               * t) + 1e-5 * rng.standard_normal(WINDOW)
            first += 50 if k == 4 else 0
            assert c.ask("STREAM", [y.tobytes()], op="push", stream=s, epoch=0, first=first,
                         count=WINDOW, crc32c=crc32c(y.tobytes())).ok
            assert (c.early.pop(0) if c.early else c.receive()).header["to"] == first + WINDOW - 1
            first += WINDOW
        yield d
        c.close()


@contextlib.contextmanager
def told_by(*words):
    """modalctl, which goes on until it is ended; what it says is waited for."""
    with subprocess.Popen([str(BUILD / "bin" / "modalctl"), *words], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True, env=environment()) as run:
        patience = threading.Timer(PATIENCE, run.kill)
        patience.start()
        try:
            yield run
        finally:
            patience.cancel()
            run.kill()


def five_windows(changing, *words, until=lambda: True):
    def modes(lines):
        return [line for line in lines if line.get("event") == "modes"]
    return modes(watched(changing, "changing", *words, until=lambda lines: len(modes(lines)) == 5
                         and until()))


def test_a_watcher_sees_damping_fall_and_the_gaps_and_the_lag_of_each_window(changing):
    lines = five_windows(changing)
    assert [line["modes"][0]["trend"] for line in lines] == ["new", "steady", "steady", "falling",
                                                             "steady"]
    assert [line["gaps"]
            for line in lines] == [{"count": 0, "samples": 0}] * 4 + [{"count": 1, "samples": 50}]
    assert all(line["lag"] == {"samples": 0, "bytes": 0} for line in lines)


def test_trend_and_gauges_follow_the_track_when_modes_change_places(tmp_path):
    """0.3 Hz decays past 1.1 Hz within six windows: the first mode of a window is another one then,
    and neither is ever new again."""
    rng, t, file = np.random.default_rng(4), DT * np.arange(6 * WINDOW), tmp_path / "a.prom"
    y = (np.exp(-0.02 * 2 * np.pi * 0.3 * t) * np.cos(2 * np.pi * 0.3 * t)
         + 0.3 * np.exp(-0.003 * t) * np.cos(2 * np.pi * 1.1 * t))
    y += 1e-4 * rng.standard_normal(len(t))
    with Daemon(workers=1) as d:
        c = d.client()
        c.ask("EVENTS", stream="changing", kinds=["modes"])
        s = c.ask("STREAM", op="open", name="changing", channels=1, dt=DT,
                  window={"samples": WINDOW, "hop": WINDOW, "options": {"rank.fixed": 4}})["stream"]
        for k in range(6):
            piece = y[k * WINDOW:(k + 1) * WINDOW].tobytes()
            assert c.ask("STREAM", [piece], op="push", stream=s, epoch=0, first=k * WINDOW,
                         count=WINDOW, crc32c=crc32c(piece)).ok
            assert (c.early.pop(0) if c.early else c.receive()).header["event"] == "modes"
        c.close()
        last = 6 * WINDOW - 1

        def written(lines):                      # the file comes after the line
            if not any(e.get("to") == last for e in lines):
                return False
            wire.until(lambda: file.exists() and gauges(file)["last_sample", None] == last)
            return True
        told = watched(d, "changing", "--prometheus", file, until=written)
        told = [e for e in told if e["event"] == "modes"]
        assert told[0]["modes"][0]["frequency_hz"] < 1 < told[5]["modes"][0]["frequency_hz"]
        assert [m["trend"] for e in told[1:] for m in e["modes"]].count("new") == 0
        of = {m["track"]: m["frequency_hz"] for m in told[0]["modes"]}
        assert all(abs(of[m["track"]] - m["frequency_hz"]) < 0.05 for e in told for m in e["modes"])
        assert all(abs(gauges(file)["frequency_hertz", str(n)] - hz) < 0.05 for n, hz in of.items())


def test_a_window_says_when_it_ended_in_seconds(changing):
    """On its line too: the last sample of the first window, DT apart from one to the next."""
    assert all(line["dt"] == DT for line in five_windows(changing))
    with told_by("--server", changing.endpoint, "watch", "changing") as run:
        assert f" {DT * (WINDOW - 1):.6g} s " in next(line for line in run.stdout
                                                      if f" to {WINDOW - 1} " in line)


@pytest.mark.parametrize("words, why", [(["nosuch"], ", and no job has that id"),
                                        (["--name", "nosuch"], "")])
def test_who_watches_what_is_not_there_is_told_what_is_waited_for(words, why, changing, ctl):
    """On stderr, once; what is there is not announced, but where a busy machine takes two seconds
    to tell it."""
    with told_by("--server", changing.endpoint, "watch", *words) as run:
        assert (run.stderr.readline()
                == f'modalctl: watch: nothing of a stream "nosuch" so far{why}; waiting for it\n')
    for _ in range(20):
        if ctl("watch", "changing", "--timeout", 3, server=changing, one=False).err == "":
            return
    pytest.fail("what is there is announced")


def test_the_last_window_is_a_file_of_gauges_that_is_replaced_whole(changing, tmp_path):
    file = tmp_path / "a.prom"

    def written():
        wire.until(lambda: file.exists() and gauges(file)["last_sample", None] == 1049)
        return True
    told = five_windows(changing, "--prometheus", file, until=written)[-1]
    last = gauges(file)
    assert (last["damping_ratio", "0"] == told["modes"][0]["damping_ratio"]
            and abs(last["damping_ratio", "0"] - 0.005) < 1e-5)
    assert last["frequency_std_hertz", "0"] == told["modes"][0]["std"]["frequency_hz"]
    assert (f'mode="{told["modes"][0]["track"]}",track="{told["modes"][0]["track"]}"'
            in file.read_text())
    assert (last["verdict", None], last["last_sample", None], last["gaps", None],
            last["gap_samples", None], last["lag_samples", None]) == (1, 1049, 1, 50, 0)
    assert not list(tmp_path.glob(".modalctl-*"))


def test_gauges_of_no_stream_are_refused(ctl, changing, tmp_path):
    said = ctl("watch", "--timeout", "1", "--prometheus", tmp_path / "a.prom",
               server=changing.endpoint)
    assert said.status == 2 and said.document["error"]["field"] == "prometheus"


@pytest.mark.parametrize("json_lines", [["--json"], []])
def test_a_stream_from_the_command_line_prints_what_watch_prints_of_it(json_lines, tmp_path):
    """0.5 Hz that falls and 0.9 Hz that lasts: each line has both, not the least damped alone."""
    t = DT * np.arange(8 * WINDOW)
    y = np.exp(-0.01 * t) * np.cos(2 * np.pi * 0.5 * t) + np.cos(2 * np.pi * 0.9 * t)
    path = write_batch(tmp_path / "run.h5", y[:, None], dt=DT)
    with Daemon(workers=1) as d:
        ctl = [str(BUILD / "bin" / "modalctl"), "--server", d.endpoint, *json_lines]
        said = subprocess.run(
            [*ctl, "stream", path, "--name", "pushed", "--window", str(WINDOW), "-o",
             "rank.fixed=4"],
            capture_output=True, text=True, timeout=PATIENCE, env=environment()).stdout.splitlines()
        with subprocess.Popen([*ctl, "watch", "pushed"], stdout=subprocess.PIPE, text=True,
                              env=environment()) as watch:
            patience = threading.Timer(PATIENCE, watch.kill)
            patience.start()
            seen = [watch.stdout.readline().rstrip("\n") for _ in said[:-1]]
            patience.cancel()
            watch.kill()
    assert len(seen) > 0
    if not json_lines:
        assert said[:-1] == seen and all(" [0] " in line and " [1] " in line for line in seen)
        return
    said, seen = [json.loads(line) for line in said[:-1]], [json.loads(line) for line in seen]
    for line in said:
        assert line.pop("sample") == line["to"]
        if line["event"] == "modes":
            assert line.pop("std") == {"frequency_hz": line["frequency_hz_std"],
                                       "damping_ratio": line["damping_ratio_std"]}
    assert said == seen
