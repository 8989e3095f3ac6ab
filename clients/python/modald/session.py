"""Questions over one connection, asked again where it was lost; what is asked of a job by its id.

Jobs stand on it, and the client on both.
"""
from __future__ import annotations

import os
import time
import weakref
from typing import Any, Callable, Sequence

from . import wire
from .answers import Answer, answer_of, document_of
from .inputs import Document
from .link import Error, Link, LOST_PATIENCE, Talk
from .results import Result

Progress = Callable[[str, float], None]
FINAL = ("done", "failed", "cancelled")
ENDED = (*FINAL, "dead")    # a dead job may be retried
ASK_AGAIN = 5.0             # s without an answer to a wait beyond what it asked for


def default_endpoint() -> str:
    """$MODALD_URL, else that of /run/modald, else of $XDG_RUNTIME_DIR."""
    url, runtime = os.environ.get("MODALD_URL"), os.environ.get("XDG_RUNTIME_DIR")
    if url:
        return url
    if runtime and not os.path.exists("/run/modald/modald.ipc"):
        return f"ipc://{runtime}/modald/modald.ipc"
    return "ipc:///run/modald/modald.ipc"


class Session:
    """A connection to one daemon, for any number of threads."""

    def __init__(self, endpoint: str | None = None, keyfile: str | None = None,
                 timeout: float | None = 60.0):
        """As `connect`; the first question finds out whether somebody is there."""
        self.endpoint = endpoint or default_endpoint()
        self.keyfile = keyfile or os.environ.get("MODALD_KEYFILE") or None
        self.timeout = timeout
        self._link = Link(self.endpoint, self.keyfile)
        self.watch: Any = None      # of its jobs: theirs, made when the first is looked at
        self._end = weakref.finalize(self, self._link.close)

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """End the connection; calls that still wait in other threads are told so."""
        self._end()

    def _deadline(self, timeout: float | None) -> float:
        timeout = self.timeout if timeout is None else timeout
        return float("inf") if timeout is None else time.monotonic() + timeout

    def ask(self, verb: str, header: Document | None = None,
            body: Sequence[bytes | memoryview] = (), timeout: float | None = None,
            once: bool = False, patience: float = ASK_AGAIN) -> tuple[Answer, list[bytes]]:
        """Ask and wait for the answer; asked again over a new connection, unless `once`."""
        deadline = self._deadline(timeout)
        with Talk(self._link) as talk:
            while True:
                talk.send(verb, header or {}, body)
                again = float("inf") if once else time.monotonic() + patience
                while True:
                    try:
                        message = talk.receive(min(deadline, again), f"no answer to {verb} in time")
                    except Error as why:
                        if why.code != "timeout" or time.monotonic() >= deadline:
                            raise
                        break
                    if message is None:
                        self._link.check()
                        if once:
                            raise Error("no_server", "the connection was lost before the answer; "
                                        "the job may have been accepted or not")
                        break
                    return answer_of(message)

    # -- jobs, by their ids -----------------------------------------------------------------------

    def status(self, job: str) -> Document:
        """The queue document of a job, an id or "key:K"."""
        return self.ask("STATUS", {"job": job})[0]

    def cancel(self, job: str) -> Document:
        """End a job, queued or running; its document."""
        return self.ask("CANCEL", {"job": job})[0]

    def retry(self, job: str) -> Document:
        """A dead job once more; its document."""
        return self.ask("RETRY", {"job": job})[0]

    def delete(self, job: str) -> Document:
        """Forget an ended job and its result."""
        return self.ask("DELETE", {"job": job})[0]

    def wait(self, job: str, timeout: float | None = None,
             progress: Progress | None = None) -> Document:
        """The document of the ended job; `timeout` raises Error with the code "timeout", up to 5 s
        later where the daemon says nothing.
        """
        deadline = float("inf") if timeout is None else time.monotonic() + timeout
        while True:
            left = deadline - time.monotonic()
            part = max(0.0, min(0.5 if progress else 20.0, left))
            document, _ = self.ask("WAIT", {"job": job, "timeout_s": part},
                                   timeout=min(part + LOST_PATIENCE, max(0.0, left) + ASK_AGAIN),
                                   patience=part + ASK_AGAIN)
            state = document.text("state")
            if state in ENDED:
                return document
            if progress:
                done: Any = document.inner("progress").get("fraction")
                good = type(done) in (int, float) and 0 <= done <= 1
                progress(state, float(done) if good else 0.0)
            if time.monotonic() >= deadline:
                raise Error("timeout", f"job {job} is {state}; not finished in time",
                            detail=document)

    def _fetch(self, job: str, part: str,
               timeout: float | None = None) -> tuple[bytes, Answer]:
        data, deadline = bytearray(), self._deadline(timeout)
        description, total = Answer(), -1
        while True:
            answer, body = self.ask("RESULT", {"job": job, "part": part, "offset": len(data)},
                                    timeout=deadline - time.monotonic())
            data += body[0] if body else b""
            description = answer.inner("batch") or description
            total = answer.count("total") if total < 0 else total
            if part != "batch" and total > wire.DOCUMENT_MOST:
                raise Error("bad_frame", f"the daemon says {total} bytes of a result; accepted: "
                            f"{wire.DOCUMENT_MOST} at most")
            if len(data) > total or total != answer.count("total"):
                raise Error("bad_frame", f"the daemon sent {len(data)} bytes of a result of {total}"
                            f", or of {answer.count('total')}")
            if len(data) == total:
                return bytes(data), description
            if not body or not body[0]:
                raise Error("bad_frame", "the daemon sent no bytes of a result")

    def result(self, job: str, timeout: float | None = None) -> Result:
        """The result of a done job, an id or "key:K"; `timeout` bounds all of its pieces."""
        return Result(document_of([self._fetch(job, "document", timeout)[0]]))

    def result_bytes(self, job: str, timeout: float | None = None) -> bytes:
        """The result to the byte."""
        return self._fetch(job, "document", timeout)[0]

    def stderr(self, job: str) -> str:
        """The last words of a worker that died of the job."""
        return self._fetch(job, "stderr")[0].decode(errors="replace")
