#!/usr/bin/python3
"""A worker for tests of the daemon: it speaks section 13 of PROTOCOL.md and does what the job's
options say.

{"sleep": s}, {"until": path that is to exist}, {"die": true | signal}, {"exit": status},
{"say": text on stderr}, {"document": bytes}, {"signals": samples}, {"late": true}: answers for the
attempt before.
{"send": [[verb, members, [bytes of each body frame]], ...]}: just that, of the current job and
attempt, in place of an answer; then READY. In the members {"text": t, "times": n} stands for a long
text.
"""
import argparse
import json
import os
import signal
import sys
import threading
import time

import zmq


def grown(value):
    if isinstance(value, dict) and set(value) == {"text", "times"}:
        return value["text"] * value["times"]
    return {k: grown(v) for k, v in value.items()} if isinstance(value, dict) else value


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--connect")
    endpoint = parser.parse_known_args()[0].connect
    socket = zmq.Context().socket(zmq.DEALER)
    socket.linger = 500
    socket.connect(endpoint)
    lock = threading.Lock()

    def say(verb, body=(), **header):
        with lock:
            socket.send_multipart([b"MODALW1", verb.encode(), json.dumps(header).encode(), *body])

    def beat():
        parent = os.getppid()
        try:
            with open(f"/proc/{parent}/comm") as comm:
                daemon = comm.read() == "modald\n"
        except OSError:                                 # it ended between these lines
            daemon = False
        # a daemon that was killed leaves no worker behind, not even one that was still starting
        while daemon and os.getppid() == parent:
            time.sleep(1)
            say("BEAT")
        os._exit(0)

    def receive():
        while True:
            with lock:
                if socket.poll(0):
                    return socket.recv_multipart()
            time.sleep(0.0005)

    def parts(job, part, data, **first):
        out = 0
        for at in range(0, len(data), 1 << 20):
            say("PART", [data[at:at + (1 << 20)]], part=part, offset=at, total=len(data), **job,
                **(first if at == 0 else {}))
            out += 1
            while out >= 4 or (out > 0 and at + (1 << 20) >= len(data)):
                if receive()[1] == b"GO":
                    out -= 1

    threading.Thread(target=beat, daemon=True).start()
    ready = {"pid": os.getpid(), "version": "fake", "core": "none"}
    say("READY", **ready)
    while True:
        frames = receive()
        if frames[1] == b"STOP":
            return 0
        if frames[1] != b"RUN":
            continue
        run = json.loads(frames[2])
        job, o = {"job": run["job"], "attempt": run["attempt"]}, run["options"]
        if "say" in o:
            print(o["say"], file=sys.stderr, flush=True)
        if "progress" in o:
            say("PROGRESS", progress={"fraction": o["progress"]}, **job)
        if "sleep" in o:
            time.sleep(o["sleep"])
        while "until" in o and not os.path.exists(o["until"]):
            time.sleep(0.005)
        if o.get("exit"):
            os._exit(o["exit"])
        if o.get("die"):
            os.kill(os.getpid(), signal.SIGKILL if o["die"] is True else o["die"])
            time.sleep(10)
        if "send" in o:
            for verb, members, bodies in o["send"]:
                say(verb, [b"A" * n for n in bodies], **{**job, **grown(members)})
        elif "fail" in o:
            say("FAILED", cpu_s=0.01,
                error={"code": o["fail"], "message": "as asked", "field": "options.fail"}, **job)
        else:
            if "signals" in o:
                n = o["signals"]
                parts(job, "batch", bytes(range(256)) * (n // 32),
                      batch={"content": "batch", "samples": n, "channels": 1, "dt": 0.5})
            document = json.dumps({"kind": run["kind"], "attempt": run["attempt"],
                                   "run_limit_s": run["run_limit_s"],
                                   "pad": "x" * o.get("document", 0)}).encode()
            if len(document) > 1 << 20:
                parts(job, "document", document)
                say("DONE", cpu_s=0.01, **job)
            else:
                say("DONE", [document], cpu_s=0.01, **job)
        say("READY", **ready)


if __name__ == "__main__":
    sys.exit(main())
