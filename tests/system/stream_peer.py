"""A stand-in for the daemon's streams, proto/PROTOCOL.md section 11, that a test can stop, hush and
bring back.

What was acknowledged is kept over `stop` and `start`, as the daemon's disk keeps it; what was not
is lost.
"""
import threading

import numpy as np
import zmq

from modald import wire


class Epoch:
    def __init__(self, channels, first):
        self.channels, self.first, self.rows, self.gaps = channels, first, {}, []

    @property
    def next(self):
        return max(self.rows) + 1 if self.rows else self.first

    def array(self):
        return np.array([self.rows[i] for i in sorted(self.rows)])


class Peer:
    def __init__(self, endpoint, credit=1 << 20):
        self.endpoint, self.credit = endpoint, credit
        self.streams, self.opens, self.closes, self.events = {}, {}, [], []
        self.silent, self.event = False, None          # event: header sent after each push, by name
        self.behind = []                               # and these after it
        self.changed = threading.Condition()
        self.thread = None

    def start(self):
        self.stopping = False
        self.context = zmq.Context()
        self.router = self.context.socket(zmq.ROUTER)
        self.router.linger = 0
        self.router.bind(self.endpoint)
        self.thread = threading.Thread(target=self.loop, daemon=True)
        self.thread.start()
        return self

    def stop(self):
        self.stopping = True
        self.thread.join()
        self.context.destroy(linger=0)

    def loop(self):
        while not self.stopping:
            if not self.router.poll(10):
                continue
            peer, version, verb, header, *body = self.router.recv_multipart()
            assert version == b"MODALD1"
            if not self.silent:
                with self.changed:
                    self.answer(peer, verb.decode(), wire.loads(header), body)
                    self.changed.notify_all()

    def send(self, peer, kind, header):
        self.router.send_multipart([peer, b"MODALD1", kind.encode(), wire.dumps(header)])

    def answer(self, peer, verb, header, body):
        reply = {"id": header["id"], "verb": verb}
        if verb == "HELLO":
            self.send(peer, "REPLY", {**reply, "version": "MODALD1"})
        elif verb == "EVENTS":
            self.events.append((peer, header["stream"], str(len(self.events))))
            self.send(peer, "REPLY", {**reply, "subscription": str(len(self.events) - 1),
                                      "next": 1})
        elif verb == "STREAM":
            getattr(self, header["op"])(peer, header, body, reply)

    def open(self, peer, header, body, reply):
        name = header["name"]
        self.opens[name] = header
        epochs = self.streams.setdefault(name, [Epoch(header["channels"], 0)])
        self.send(peer, "REPLY", {**reply, "stream": "id-" + name, "name": name,
                                  "epoch": len(epochs) - 1, "next": epochs[-1].next,
                                  "credit": self.credit})

    def push(self, peer, header, body, reply):
        name = header["stream"][3:]
        epoch, n = self.streams[name][-1], self.streams[name][-1].channels
        assert (wire.crc32c(body[0]) == header["crc32c"] and len(body[0]) == 8 * n * header["count"]
                <= 1 << 20)
        rows = [body[0][8 * n * i:8 * n * (i + 1)] for i in range(header["count"])]
        if any(epoch.rows.get(header["first"] + i, row) != row for i, row in enumerate(rows)):
            # other bytes at an index: a new epoch
            epoch = Epoch(n, header["first"])
            self.streams[name].append(epoch)
        if header["first"] > epoch.next:
            epoch.gaps.append([epoch.next, header["first"]])
        epoch.rows.update((header["first"] + i, row) for i, row in enumerate(rows))
        self.send(peer, "REPLY", {**reply, "stream": header["stream"],
                                  "epoch": len(self.streams[name]) - 1, "next": epoch.next,
                                  "credit": self.credit})
        for to, subscribed, number in self.events:
            if self.event and subscribed == name:
                for event in [self.event, *self.behind]:
                    self.send(to, "EVENT", {"subscription": number, "number": 1, "event": "modes",
                                            "stream": name, "to": epoch.next - 1, **event})

    def close(self, peer, header, body, reply):
        name = header["stream"][3:]
        self.closes.append((name, header.get("broken", False)))
        self.send(peer, "REPLY", {**reply, "stream": header["stream"],
                                  "samples": len(self.streams[name][-1].rows), "gaps": [],
                                  "sha256": "0" * 64})

    # -- what a test asks
    # -----------------------------------------------------------------------------------------

    def record(self, name, epoch=-1):
        """All rows of an epoch as numbers."""
        kept = self.streams[name][epoch]
        return np.frombuffer(b"".join(kept.rows[i] for i in sorted(kept.rows)),
                             dtype="<f8").reshape(-1, kept.channels)

    def wait(self, true, seconds=120):
        with self.changed:
            assert self.changed.wait_for(true, seconds)
