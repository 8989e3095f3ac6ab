"""What a daemon answers, looked at before it is believed: what it lacks is an Error, "bad_frame".

Whoever listens at the endpoint may be no modald, or one of another version.
"""
from __future__ import annotations

from typing import Any, Sequence

from . import wire
from .link import Error


class Answer(dict[str, Any]):
    """The members of an answer, or of a document in its body: a dictionary as any other, and by
    these methods what is read of it here."""

    def _wrong(self, name: str, accepted: str) -> Error:
        said = f"says {str(self[name])[:60]!r}" if name in self else "has none"
        return Error("bad_frame", f"the daemon's answer {said} as `{name}`; accepted: {accepted}")

    def text(self, name: str) -> str:
        """A text."""
        if not isinstance(self.get(name), str):
            raise self._wrong(name, "a text")
        return str(self[name])

    def count(self, name: str) -> int:
        """A whole number, 0 and up."""
        value: Any = self.get(name)
        if type(value) not in (int, float) or value != int(value) or value < 0:
            raise self._wrong(name, "a whole number, 0 and up")
        return int(value)

    def rows(self, name: str) -> "list[Answer]":
        """A list of objects."""
        value = self.get(name)
        if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
            raise self._wrong(name, "a list of objects")
        return [Answer(row) for row in value]

    def inner(self, name: str) -> "Answer":
        """An object; empty where there is none."""
        value = self.get(name)
        if value is not None and not isinstance(value, dict):
            raise self._wrong(name, "an object")
        return Answer(value or {})

    def job(self) -> "Answer":
        """Itself, a queue document."""
        self.text("job")
        self.text("state")
        return self


def answer_of(message: tuple[str, dict[str, Any], list[bytes]]) -> tuple[Answer, list[bytes]]:
    """Members and body of a message; an ERROR is raised."""
    kind, header, parts = message
    if kind == "ERROR":
        raise Error.of(header.get("error"))
    return Answer({key: value for key, value in header.items() if key not in ("id", "verb")}), parts


def value_of(body: Sequence[bytes]) -> Any:
    """What an answer's body says, which is JSON."""
    try:
        return wire.loads(body[0])
    except (IndexError, ValueError) as why:
        raise Error("bad_frame", f"the daemon's answer has no document: {why}") from why


def document_of(body: Sequence[bytes]) -> Answer:
    """The same, an object."""
    document = value_of(body)
    if not isinstance(document, dict):
        raise Error("bad_frame", "the daemon's answer is a document, but no object")
    return Answer(document)
