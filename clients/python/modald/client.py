"""A connection to modald: every verb of proto/PROTOCOL.md, and jobs from input to result.

It reconnects by itself and never waits longer than it is told.
"""
from __future__ import annotations

import math
import os
import secrets
import time
from dataclasses import dataclass, field
from typing import Any, Iterable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from . import wire
from .answers import Answer, answer_of, document_of, value_of
from .inputs import as_array, as_sent, Batch, Document, Input, same_step, Scene, scene_text
from .jobs import Job
from .link import Error, Talk
from .progress import shown
from .results import Result
from .session import ENDED, Progress, Session

SHARES_MOST = 64            # of a sweep: as many workers may have one each
TOGETHER_MOST = 64          # submissions in one message
CHUNK_PATIENCE = 10.0       # s without an answer while chunks are under way: begin again


@dataclass
class Event:
    """One numbered edge, progress, or a stream's live result."""

    header: Document
    number: int | None = field(init=False)

    def __post_init__(self) -> None:
        self.number = self.header.get("number")

    def __getitem__(self, key: str) -> Any:
        """A member of its header."""
        return self.header[key]


def options_of(given: Mapping[str, Any]) -> Document | None:
    """Keyword arguments as options of identify, none of which has an underscore: `rank_fixed` is
    `rank.fixed`."""
    return {name.replace("_", "."): value for name, value in given.items()} or None


# what else a submission may say
LIMITS = ("key", "priority", "run_limit", "deadline", "not_before", "max_attempts", "fresh")


class Client(Session):
    """A connection, for any number of threads: one of its own speaks with the daemon.

    Who asks waits for his answer alone.  `timeout` [s] bounds every call that is not given its own;
    None: no bound but a lost daemon's 30 s.  After `close` every call, also one that waits in
    another thread, is an Error.  A client is not taken over a fork: the child makes its own."""

    def __enter__(self) -> "Client":
        """Itself; `with` closes it."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """A pickled client is one of the same endpoint and key file, where it is unpickled."""
        return Client, (self.endpoint, self.keyfile, self.timeout)

    # -- inputs -----------------------------------------------------------------------------------

    def _sealed(self, word: str) -> str:
        """What the daemon calls the latest record of "stream:NAME"."""
        if not word.startswith("stream:"):
            raise Error("bad_input", f"{word[:60]!r} is no input; accepted: a Batch, a scene, "
                        "\"stream:NAME\"; modald.read() reads a file", "input")
        name = word.removeprefix("stream:")
        is_open = False
        for one in self.streams(name, limit=2):
            stream = Answer(one)
            if stream.text("state") == "sealed":
                return stream.text("upload")
            is_open = True
        if is_open:
            raise Error("conflict", f"stream {name[:60]!r} is open: it is a batch once it is "
                        "closed", "stream")
        raise Error("not_found", f"no stream {name[:60]!r} of yours is kept here", "stream")

    def upload(self, value: Input, timeout: float | None = None,
               progress: Progress | None = None) -> str:
        """Bring an input, resuming where an earlier try ended; its identity, to submit jobs on."""
        return self._bring(value, timeout, progress)[1]

    def _bring(self, value: Input, timeout: float | None = None,
               progress: Progress | None = None) -> tuple[str, str]:
        """Its upload, which tells it from inputs of other attributes, and its identity."""
        description, data, sha256 = as_sent(value)
        if description["content"] == "scene":
            description.update(wire.scene_lengths(data))
        deadline = self._deadline(timeout)
        while True:
            begun, _ = self.ask("UPLOAD", {"op": "begin", "sha256": sha256, **description},
                                timeout=deadline - time.monotonic())
            try:
                if begun.text("state") == "sealed" or self._chunks(begun, data, deadline, progress):
                    break
            except Error as why:
                if why.code != "busy" or time.monotonic() >= deadline:
                    raise
                time.sleep(why.pause(0.2))
            if time.monotonic() >= deadline:
                raise Error("timeout", "the upload was not finished in time")
        if begun["state"] != "sealed":
            self.ask("UPLOAD", {"op": "seal", "upload": begun.text("upload"), "sha256": sha256},
                     timeout=deadline - time.monotonic())
        return begun.text("upload"), sha256

    def _chunks(self, begun: Answer, data: memoryview, deadline: float,
                progress: Progress | None) -> bool:
        """All chunks from `present` on, within the credit; False: the connection was lost."""
        present, credit, upload = (begun.count("present"), begun.count("credit"),
                                   begun.text("upload"))
        sent = present
        with Talk(self._link) as talk:
            while present < len(data):
                while sent < len(data):
                    chunk = data[sent:sent + wire.CHUNK_MOST]
                    if sent > present and sent + len(chunk) - present > credit:
                        break
                    talk.send("UPLOAD", {"op": "chunk", "upload": upload, "offset": sent,
                                         "crc32c": wire.crc32c(chunk)}, [chunk])
                    sent += len(chunk)
                try:
                    message = talk.receive(min(deadline, time.monotonic() + CHUNK_PATIENCE))
                except Error as why:
                    if why.code != "timeout":
                        raise
                    return False
                if message is None:
                    return False
                answer, _ = answer_of(message)
                present = max(present, answer.count("present"))
                credit = answer.count("credit")
                if progress:
                    progress("upload", present / len(data))
        return True

    # -- the queue --------------------------------------------------------------------------------

    def submit(self, kind: str, value: Input | None = None, options: Document | None = None, *,
               sha256: str | None = None, key: str | None = None, priority: int | None = None,
               run_limit: float | None = None, deadline: float | None = None,
               not_before: float | None = None, max_attempts: int | None = None,
               fresh: bool = False, timeout: float | None = None) -> Job:
        """Put a job on the queue: on `value`, or on an input brought before, by its identity."""
        header, body = self.submission(kind, value, options, sha256=sha256, timeout=timeout)
        for name, given in (("key", key), ("priority", priority), ("run_limit_s", run_limit),
                            ("deadline_s", deadline), ("not_before", not_before),
                            ("max_attempts", max_attempts), ("fresh", fresh or None)):
            if given is not None:
                header[name] = given
        answer, _ = self.ask("SUBMIT", header, body, timeout=timeout, once=key is None)
        return Job(self, answer)

    def submission(self, kind: str, value: Input | None, options: Document | None, *,
                   sha256: str | None = None,
                   timeout: float | None = None) -> tuple[Document, list[memoryview]]:
        """Header and body of a SUBMIT; a large input is uploaded first."""
        header: Document = {"kind": kind}
        if options:
            header["options"] = options
        if isinstance(value, str):
            return {**header, "input": {"upload": self._sealed(value)}}, []
        if sha256 is not None:
            return {**header, "input": {"sha256": sha256}}, []
        if value is None:
            raise Error("bad_input", "a job needs an input", "input")
        description, data, _ = as_sent(value)
        if len(data) > wire.INLINE_MOST:
            return {**header, "input": {"upload": self._bring(value, timeout)[0]}}, []
        return {**header, "input": description}, [data]

    def submit_many(self, jobs: Sequence[tuple[str, Input, Document | None, str]],
                    window: int = 256,
                    timeout: float | None = None) -> list[Job]:
        """Submissions (kind, input, options, key), each accepted once; the jobs in their order.

        `window` of them are in flight, many in a message.
        """
        deadline = self._deadline(timeout)
        out: list[Job | None] = [None] * len(jobs)
        waiting = list(range(len(jobs) - 1, -1, -1))
        together = max(1, min(TOGETHER_MOST, window // 4))
        flying: dict[int, list[int]] = {}
        ready: dict[int, tuple[Document, list[memoryview]]] = {}
        for i, (kind, value, options, key) in enumerate(jobs):
            header, body = self.submission(kind, value, options, timeout=timeout)
            ready[i] = ({**header, "key": key}, body)
        with Talk(self._link) as talk:
            while waiting or flying:
                most = max(window, together)
                while waiting and sum(map(len, flying.values())) + together <= most:
                    number, parts = self._send_some(talk, ready, waiting, together)
                    flying[number] = parts
                message = talk.receive(deadline)
                if message is None:                     # again: the keys tell what was accepted
                    self._link.forget(talk)
                    waiting.extend(i for parts in flying.values() for i in parts)
                    flying.clear()
                    continue
                kind, answer, bodies = message
                parts = flying.pop(answer.get("id", 0), [])
                if (kind == "ERROR" and together > 1
                        and Error.of(answer.get("error")).code == "unknown_verb"):
                    together = 1                        # a daemon of before SUBMITS
                    waiting.extend(parts)
                    continue
                several = kind == "REPLY" and len(parts) > 1
                answers = (document_of(bodies).rows("jobs") if several
                           else [Answer(answer)] * len(parts))
                if len(answers) != len(parts):
                    raise Error("bad_frame", f"the daemon answers {len(answers)} of {len(parts)} "
                                "submissions")
                waiting.extend(self._take(parts, answers, out))
        return [job for job in out if job is not None]

    def _send_some(self, talk: Talk, ready: Mapping[int, tuple[Document, list[memoryview]]],
                   waiting: list[int], most: int) -> tuple[int, list[int]]:
        """As many of `waiting`, from its end, as one message takes: its number and theirs."""
        parts: list[int] = []
        header = length = 0
        while waiting and len(parts) < most:
            part, body = ready[waiting[-1]]
            header += len(self._link.frames("SUBMIT", part, body)[2]) + 16
            length += sum(map(len, body))
            if parts and (header > wire.HEADER_MOST - 64 or length > wire.BODY_MOST):
                break
            parts.append(waiting.pop())
        if len(parts) == 1:
            return talk.send("SUBMIT", *ready[parts[0]]), parts
        bodies = b"".join(chunk for i in parts for chunk in ready[i][1])
        return talk.send("SUBMITS", {"jobs": [self._part(*ready[i]) for i in parts]},
                         [bodies] if bodies else []), parts

    @staticmethod
    def _part(header: Document, body: Sequence[memoryview]) -> Document:
        """A submission in SUBMITS: there a scene says how long it is, too."""
        if header["input"].get("content") != "scene":
            return header
        return {**header, "input": {**header["input"], "bytes": sum(map(len, body))}}

    def _take(self, parts: Sequence[int], answers: Sequence[Answer],
              out: list[Job | None]) -> list[int]:
        """Accepted jobs into `out`; those that are to be sent again, after a pause."""
        again, pause = [], 0.0
        for i, answer in zip(parts, answers):
            if "job" in answer or "error" not in answer:
                out[i] = Job(self, {name: value for name, value in answer.items()
                                    if name not in ("id", "verb")})
                continue
            error = Error.of(answer["error"])
            if error.code not in ("busy", "draining") and "retry_after_s" not in error.detail:
                raise error
            pause = max(pause, error.pause(0.1))
            again.append(i)
        time.sleep(pause)
        return again

    def signals(self, job: str, timeout: float | None = None) -> Batch:
        """The batch that a `simulate` job made; `timeout` bounds all of its pieces."""
        data, d = self._fetch(job, "batch", timeout)
        shape = d.count("samples"), d.count("channels")
        if len(data) != 8 * shape[0] * shape[1]:
            raise Error("bad_frame", f"the daemon sent {len(data)} bytes as {shape[0]} samples of "
                        f"{shape[1]} channels")
        dt: Any = d.get("dt")
        return Batch(np.frombuffer(data, dtype="<f8").reshape(shape), dt, d.get("period"),
                     d.get("names"), d.get("units"))

    def _paged(self, verb: str, rows: str, header: Document) -> Iterator[Document]:
        """Row by row, a page at a time: each has some that are new, or there is no next one."""
        while True:
            page = document_of(self.ask(verb, header)[1])
            found, after = page.rows(rows), page.get("next")
            if len(found) > header["limit"] or after is not None and (
                    not found or page.text("next") == header.get("after")):
                raise Error("bad_frame", f"the daemon's page of {len(found)} {rows} leads nowhere")
            yield from found
            if after is None:
                return
            header["after"] = after

    def list(self, state: str | None = None, kind: str | None = None,
             limit: int = 100) -> Iterator[Document]:
        """Documents of all jobs, `limit` a page, of one `state` and `kind` where they are given."""
        return self._paged("LIST", "jobs", {"limit": limit, **({"state": state} if state else {}),
                                            **({"kind": kind} if kind else {})})

    def streams(self, name: str | None = None, user: str | None = None,
                limit: int = 100) -> Iterator[Document]:
        """Live and recent streams, the newest first, `limit` a page; those of `name`, of `user`.

        Each has `name`, `user`, `state` ("open", "closing", "sealed"), `channels`, `dt` [s],
        `samples`, `age_s`; an open one with a live window `verdict`, `lag` and `skipped`; a sealed
        one `upload`, `sha256`, and `kept_s` until it goes where no job names it.
        """
        return self._paged("STREAMS", "streams", {"limit": limit,
                                                  **({"name": name} if name else {}),
                                                  **({"user": user} if user else {})})

    def events(self, start: int | None = None, job: str | None = None, stream: str | None = None,
               timeout: float | None = None) -> Iterator[Event]:
        """Events as they happen, over a connection of their own, of one `job` or `stream`.

        From number `start` on, without a hole over reconnections.  After `timeout` s there are no
        more: the iteration ends.
        """
        deadline = float("inf") if timeout is None else time.monotonic() + timeout
        with Client(self.endpoint, self.keyfile, self.timeout) as other:
            while True:
                with Talk(other._link) as talk:
                    talk.listens = True
                    talk.send("EVENTS", {**({"from": start} if start is not None else {}),
                                         **({"job": job} if job else {}),
                                         **({"stream": stream} if stream else {})})
                    subscription = None
                    while True:
                        try:
                            message = talk.receive(deadline)
                        except Error as why:
                            if why.code == "timeout":
                                return
                            raise
                        if time.monotonic() >= deadline:        # also where they never end
                            return
                        if message is None:
                            break
                        kind, event, _ = message
                        if kind != "EVENT":
                            subscription = answer_of(message)[0].text("subscription")
                        elif event.pop("subscription", None) == subscription:
                            if event.get("number") is not None:
                                start = Answer(event).count("number") + 1
                            yield Event(event)
                other._link.check()

    def hello(self) -> Document:
        """Versions and limits of the daemon."""
        return self.ask("HELLO", {"versions": ["MODALD1"], "client": "python 0.1.0"})[0]

    def stats(self) -> Document:
        """Counts and sizes of the service; `["workers"]["names"]`: of workers of other hosts."""
        stats, body = self.ask("STATS")
        if body:
            stats["workers"] = {**stats.inner("workers"), "names": value_of(body)}
        return stats

    def whoami(self) -> Document:
        """User, role, limits and use."""
        return self.ask("WHOAMI")[0]

    def metrics(self) -> str:
        """Prometheus text."""
        return b"".join(self.ask("METRICS")[1]).decode(errors="replace")

    def drain(self) -> Document:
        """Take and start no more jobs (role admin)."""
        return self.ask("DRAIN")[0]

    def undrain(self) -> Document:
        """Take and start jobs again (role admin)."""
        return self.ask("UNDRAIN")[0]

    # -- jobs, from input to result ---------------------------------------------------------------

    def run(self, kind: str, value: Input, options: Document | None = None,
            timeout: float | None = None, **limits: Any) -> Result:
        """Submit, wait (`timeout` s at most), fetch; a job's own error is raised.

        `limits` as of `submit`.
        """
        for name in limits:
            if name not in LIMITS:
                raise Error("bad_input",
                            f"{name} is no keyword here; accepted: {', '.join(LIMITS)}; "
                            f"of the job's own: options={{\"{name}\": ...}}", name)
        limits.setdefault("key", "python-" + secrets.token_hex(16))
        return self.submit(kind, value, options, **limits).result(timeout)

    def map(self, batches: Iterable[Batch], *, timeout: float | None = None,
            progress: bool = False, **options: Any) -> Iterator[Result]:
        """Identify all of `batches`, beside each other; the results in their order.

        `options` are identify's, a dot written as an underscore (`rank_fixed=6`).  All are
        submitted before this returns; `timeout` [s] bounds all of it, `progress` shows a bar.  The
        first that fails raises its error; jobs that nobody will fetch then are cancelled.
        """
        deadline = float("inf") if timeout is None else time.monotonic() + timeout
        jobs = self.submit_many([("identify", batch, options_of(options),
                                  "python-" + secrets.token_hex(16)) for batch in batches],
                                timeout=timeout)
        return self._results(jobs, deadline, progress)

    def _results(self, jobs: Sequence[Job], deadline: float, progress: bool) -> Iterator[Result]:
        try:
            for job in shown(jobs, len(jobs), progress):
                left = deadline - time.monotonic()
                yield job.result(None if left == float("inf") else max(0.0, left))
        finally:
            for job in jobs:
                if job.state not in ENDED:
                    job.cancel()

    def identify(self, signals: npt.ArrayLike | Batch | str, dt: float | None = None,
                 options: Document | None = None, *,
                 period: float | None = None, names: Sequence[str] | None = None,
                 timeout: float | None = None, **limits: Any) -> Result:
        """Modes of `signals`, shape (samples,) or (samples, channels) at steps of `dt` s, or of a
        Batch; `period` [s] of a periodic system, `names` of the channels.  "stream:NAME" is the
        latest record of a stream, which the daemon has.
        """
        if isinstance(signals, Batch):
            same_step(dt, signals.dt, "the batch")
        elif not isinstance(signals, str) or not signals.startswith("stream:"):
            if isinstance(signals, (str, os.PathLike)):
                raise Error("bad_input",
                            f"{str(signals)!r} is no signals; accepted: an array with its dt, "
                            "a Batch, as modald.read(path) makes of a file, or \"stream:NAME\"",
                            "signals")
            if dt is None:
                raise Error("bad_input", "dt is needed: seconds between samples, 1 over the rate",
                            "dt")
            signals = Batch(as_array(signals), dt, period, names)
        return self.run("identify", signals, options, timeout, **limits)

    def steady(self, scene: Scene, options: Document | None = None, timeout: float | None = None,
               **limits: Any) -> Result:
        """The steady state of `scene`, a dictionary as modald-scene(5) says, or with `options` its
        response curve.
        """
        return self.run("steady", scene, options, timeout, **limits)

    def floquet(self, scene: Scene, options: Document | None = None, timeout: float | None = None,
                **limits: Any) -> Result:
        """Multipliers and exponents of a linear `scene`."""
        return self.run("floquet", scene, options, timeout, **limits)

    def simulate(self, scene: Scene, options: Document | None = None, timeout: float | None = None,
                 **limits: Any) -> tuple[Result, Batch]:
        """The motion of `scene`: the result, and the samples as a Batch."""
        limits.setdefault("key", "python-" + secrets.token_hex(16))
        job = self.submit("simulate", scene, options, **limits)
        return job.result(timeout), self.signals(job.id)

    def sweep(self, document: Scene, options: Document | None = None, timeout: float | None = None,
              **limits: Any) -> Result:
        """A scene over a grid of its values: shares of the points as jobs over all workers, as one
        table.  The same sweep finds its jobs again, also after a restart of either side."""
        deadline = float("inf") if timeout is None else time.monotonic() + timeout
        try:
            points = math.prod(len(axis["values"]) for axis in document["grid"])
        except (KeyError, TypeError) as why:
            raise Error("bad_input", "a sweep has a grid: a list of objects with path and values",
                        "grid") from why
        shares = max(1, min(SHARES_MOST, points))
        cuts = [points * i // shares for i in range(shares + 1)]
        same = wire.scene_identity(scene_text([document, options]))
        stem = limits.pop("key", None) or "python-sweep-" + same
        jobs = [self._share(document, {**(options or {}), "first": a, "count": b - a},
                            f"{stem}:{a}", deadline, limits) for a, b in zip(cuts, cuts[1:])]
        try:
            parts = [job.result(None if timeout is None else max(0.0, deadline - time.monotonic()))
                     for job in jobs]
        except Error as why:
            if why.code not in ("timeout", "no_server"):
                for job in jobs:
                    job.cancel()
            raise
        try:
            return self._joined(parts, points)
        except (KeyError, TypeError, AttributeError) as why:
            raise Error("bad_frame", f"the daemon's results are no sweep's: {why!r}") from why

    @staticmethod
    def _joined(parts: Sequence[Result], points: int) -> Result:
        """The first of the shares with what the others have."""
        whole = parts[0]
        for part in parts[1:]:
            whole["points"] += part["points"]
            for cost, more in ((whole["cost"], part["cost"]),
                               (whole["cost"]["stages"], part["cost"]["stages"])):
                cost.update({key: max(cost[key], more[key]) if key == "peak_bytes"
                             else cost[key] + more[key] for key in cost if key != "stages"})
        whole["provenance"]["options"]["count"] = points
        return whole

    def _share(self, document: Scene, options: Document, key: str, deadline: float,
               limits: Document) -> Job:
        """Under the first key that is not spent on a job without a result."""
        number = 0
        while True:
            try:
                job = self.submit("sweep", document, options, key=f"{key}:{number}", **limits)
                ended = job.state in ("failed", "cancelled", "dead")
                if not job.document.get("duplicate") or not ended:
                    return job
                number += 1
            except Error as why:
                if why.code not in ("busy", "expired"):
                    raise
                number += why.code == "expired"
                if time.monotonic() >= deadline:
                    raise
                if why.code == "busy":
                    time.sleep(why.pause(1))


def connect(endpoint: str | None = None, keyfile: str | None = None,
            timeout: float | None = 60.0) -> Client:
    """A client of the daemon at `endpoint`.

    Default $MODALD_URL, else /run/modald, else $XDG_RUNTIME_DIR/modald.  `keyfile` (default
    $MODALD_KEYFILE) where the daemon wants keys; `timeout` [s] bounds each call.
    """
    return Client(endpoint, keyfile, timeout)
