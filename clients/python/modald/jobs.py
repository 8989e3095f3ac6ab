"""A job as a future: asked of the daemon when somebody looks, never before.

`concurrent.futures` looks at a future through its condition, so that is where the watch begins;
`wait`, `as_completed`, callbacks and `asyncio.wrap_future` then work on jobs as on any future.
"""
from __future__ import annotations

import collections
import concurrent.futures
import os
import threading
import time
from typing import Any, Iterable, Iterator

from .answers import Answer, answer_of
from .inputs import Document
from .link import Error, Link, Talk
from .progress import shown
from .results import Result
from .session import ENDED, FINAL, Session

WATCHED_MOST = 1024         # WAITs of one client that are open: a quarter of what a user may have
WATCH_S = 20.0              # s that one of them is open
PAUSE_S = 0.05              # s before the watch asks again what was refused

# A future's own word for its end: who asks `done()` takes its condition.
_FUTURE_OVER = ("CANCELLED", "CANCELLED_AND_NOTIFIED", "FINISHED")

# Of all jobs and watches: nothing that takes long is done under it.
_lock = threading.Lock()


def _after_fork() -> None:
    """The child has its own: the parent's thread that held it is not here to give it back."""
    global _lock
    _lock = threading.Lock()


os.register_at_fork(after_in_child=_after_fork)


class Job(concurrent.futures.Future):  # type: ignore[type-arg]
    """A job on the queue, as a `concurrent.futures.Future` and as its queue document.

    `document` is what the daemon last said of it; `status()` and `wait()` ask again.
    """

    def __init__(self, client: Session, document: Document):
        """Of `client`, which is asked again; `document` as SUBMIT or STATUS answers."""
        self._over = self._watched = False
        self._process = os.getpid()
        super().__init__()
        self.client, self.document = client, document
        self._answer: Result | None = None
        self._end(Answer(document).job())

    @property
    def _condition(self) -> threading.Condition:
        """The future's; who asks for it looks at the future, and the watch begins."""
        with _lock:
            self._take()
            begin = not self._over and not self._watched
            self._watched = True
        if begin:
            watch_of(self.client).add(self)
        return self._own_condition

    @_condition.setter
    def _condition(self, value: threading.Condition) -> None:
        self._own_condition = value

    def _take(self) -> None:
        """Under the lock: a fork's child has none of the threads that held or were to end it."""
        if self._process == os.getpid():
            return
        self._process, self._watched = os.getpid(), False
        self._own_condition = threading.Condition()
        self._over = vars(self)["_state"] in _FUTURE_OVER

    def __reduce__(self) -> tuple[Any, ...]:
        """A pickled job finds its client by the endpoint."""
        return Job, (self.client, self.document)

    def __repr__(self) -> str:
        """Number, kind and state."""
        return f"<modald.Job {self.id} {self.document.get('kind', '')} {self.state}>"

    @property
    def id(self) -> str:
        """The daemon's name for it."""
        return str(self.document["job"])

    @property
    def state(self) -> str:
        """Of the last answer: queued, running, done, failed, cancelled or dead."""
        return str(self.document["state"])

    def running(self) -> bool:
        """Whether a worker had it, by the last answer."""
        return self.state == "running"

    def _end(self, document: Document) -> None:
        """What the daemon says; at its end the future ends, once."""
        Answer(document).job()
        with _lock:
            self._take()
            self.document = document
            if document.get("state") not in ENDED or self._over:
                return
            self._over = True                       # there is nothing more to watch
        if document["state"] == "cancelled":
            super().cancel()
            self.set_running_or_notify_cancel()
        elif document["state"] == "done":
            self.set_result(None)
        else:
            self.set_exception(self._error())

    def _fail(self, why: Error) -> None:
        """The watch cannot go on."""
        with _lock:
            self._take()
            if self._over:
                return
            self._over = True
        self.set_exception(why)

    def _error(self) -> Error:
        return Error.of(self.document.get("error")
                        or {"code": self.state, "message": f"the job is {self.state}"})

    def status(self) -> "Job":
        """Ask for its document now; gives itself."""
        self._end(self.client.status(self.id))
        return self

    def wait(self, timeout: float | None = None) -> "Job":
        """Wait for its end, `timeout` s at most (Error "timeout"); gives itself."""
        if self.state not in FINAL:
            self._end(self.client.wait(self.id, timeout))
        return self

    def result(self, timeout: float | None = None) -> Result:
        """Wait for the job's end, `timeout` s at most, and give its result.

        The client's own `timeout` bounds the fetching of what is there, all pieces of it.  The
        job's own error is raised, as is `timeout`: both are `modald.Error`.
        """
        self.wait(timeout)
        if self.state != "done":
            raise self._error()
        if self._answer is None:
            self._answer = self.client.result(self.id)
        return self._answer

    def exception(self, timeout: float | None = None) -> Error | None:
        """Wait for the job's end, `timeout` s at most; its error, or None where it is done."""
        self.wait(timeout)
        return None if self.state == "done" else self._error()

    def cancel(self) -> bool:
        """End it, queued or running; whether it is cancelled (an ended job stays as it is)."""
        try:
            self._end(self.client.cancel(self.id))
        except Error as why:
            if why.code != "conflict":
                raise
            self.status()
        return self.state == "cancelled"


class Watch:
    """The WAITs of one client's jobs, many at a time, in a thread that ends with the link."""

    def __init__(self, link: Link):
        """Nothing is asked before the first job is added."""
        self.link = link
        self._waiting: collections.deque[Job] = collections.deque()
        self._thread: threading.Thread | None = None

    def add(self, job: Job) -> None:
        """Say when JOB has ended."""
        with _lock:
            self._waiting.append(job)
            if self._thread is None or not self._thread.is_alive():     # a fork's child has none
                self._thread = threading.Thread(target=self._run, name="modald-jobs", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        flying: dict[int, Job] = {}
        try:
            with Talk(self.link) as talk:
                while self._send(talk, flying):
                    self._hear(talk, flying)
        except Exception as why:  # nobody shall wait for a thread that is gone
            with _lock:
                failed = [*flying.values(), *self._waiting]
                self._waiting.clear()
                self._thread = None
            for job in failed:
                job._fail(why if isinstance(why, Error)
                          else Error("internal", f"the watch of jobs ended: {why!r}"))

    def _send(self, talk: Talk, flying: dict[int, Job]) -> bool:
        """As many as may be open; False, and the thread is gone: there is nothing to watch."""
        with _lock:
            while self._waiting and len(flying) < WATCHED_MOST:
                job = self._waiting[0]
                flying[talk.send("WAIT", {"job": job.id, "timeout_s": WATCH_S})] = job
                self._waiting.popleft()
            if not flying:
                self._thread = None
            return bool(flying)

    def _hear(self, talk: Talk, flying: dict[int, Job]) -> None:
        """One answer; or none for a moment, in which jobs may have been added."""
        try:
            message = talk.receive(time.monotonic() + PAUSE_S)
        except Error:
            self.link.check()                           # nobody is there any more, or not yet again
            return
        if message is None:                             # a lost connection took the WAITs along
            self.link.forget(talk)
            self._again(flying.values())
            flying.clear()
            return
        job = flying.pop(message[1].get("id", 0), None)
        if job is None:
            return
        try:
            document, _ = answer_of(message)
            job._end(document)
            if document["state"] not in ENDED:
                self._again([job])
        except Error as why:
            if why.code in ("busy", "quota"):
                time.sleep(PAUSE_S)
                self._again([job])
            else:
                job._fail(why)

    def _again(self, jobs: Iterable[Job]) -> None:
        with _lock:
            self._waiting.extend(jobs)


def watch_of(session: Session) -> Watch:
    """The watch of a session's jobs: one, whichever thread asks first."""
    with _lock:
        if session.watch is None:
            session.watch = Watch(session._link)
    return session.watch  # type: ignore[no-any-return]


def as_completed(jobs: Iterable[Job], timeout: float | None = None,
                 progress: bool = False) -> Iterator[Job]:
    """The jobs as they end, in that order; `timeout` [s] bounds all of it (Error "timeout").

    `progress`: a bar by tqdm where that is installed, else a line on stderr.
    """
    several = list(jobs)
    ended: Iterator[Any] = concurrent.futures.as_completed(several, timeout)
    try:
        yield from shown(ended, len(several), progress)
    except concurrent.futures.TimeoutError as why:
        left = sum(job.state not in ENDED for job in several)
        raise Error("timeout", f"{left} of {len(several)} jobs have not ended in time") from why
