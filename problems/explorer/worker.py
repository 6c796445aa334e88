"""Processes that compute for a page: each answers the newest question, and can be stopped at any moment.

A page is drawn by a server that never computes, so that ten of them do not disturb each other. What is asked while a
worker computes replaces what was asked before it, so that the moves of a slider never queue; a computation that takes
long is ended by killing its process, since compiled code heeds nothing else.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from orbits.errors import OrbitsError

from .answers import ANSWERS
from .processes import process_context

LOST = (
    "the process that computed this has ended: there may be too little memory, or a script has called explore without"
    "  if __name__ == '__main__':"
)
# A computation that has taken this long (s) is ended when something newer is asked.
IMPATIENT = 3.0


@dataclass(frozen=True)
class Task:
    """What a worker is asked: a name of `answers.ANSWERS` and its arguments; no two have the same number."""

    name: str
    arguments: tuple[Any, ...]
    number: int = field(default_factory=count().__next__)


@dataclass(frozen=True)
class Failure:
    """Why there is no answer, in words."""

    reason: str


@dataclass(frozen=True)
class Done:
    """The end of the answers to a question."""


class Worker:
    """A process that answers questions.

    deliver : called with a question and each of its answers, the last of them `Done` or a `Failure`, in a thread of its
        own; nothing may come of a question that a newer one has replaced
    calm : whether it leaves the processor to others, for what goes on in the background
    given : the machine of the page, where no statement makes it
    """

    def __init__(self, deliver: Callable[[Task, Any], None], given: Any = None, calm: bool = False):
        self._deliver, self._given, self._calm = deliver, given, calm
        self._lock = threading.Lock()
        self._process: Any = None
        self._pipe: Any = None
        self._asked: Task | None = None  # the newest, until its last answer has come
        self._since = 0.0

    @property
    def busy(self) -> float:
        """For how many seconds it has been computing; 0.0 where it waits."""
        return time.monotonic() - self._since if self._asked is not None else 0.0

    def ask(self, question: Task) -> None:
        """Ask for answers to a question, in the place of what was asked before."""
        with self._lock:
            if self._asked is not None and self.busy > IMPATIENT:
                self._end()
            if self._process is None or not self._process.is_alive():
                self._begin()
            if self._asked is None:
                self._since = time.monotonic()
            self._asked = question
            with suppress(OSError):  # of a process that has just died, which its reader tells
                self._pipe.send(question)

    def stop(self) -> None:
        """End what is computed, at once; the next question begins a new process."""
        with self._lock:
            self._end()

    def _begin(self) -> None:
        context = process_context()
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=answer_questions, args=(theirs, self._given, self._calm), daemon=True)
        self._process.start()
        theirs.close()
        threading.Thread(target=self._read, args=(self._process, self._pipe), daemon=True).start()

    def _end(self) -> None:
        """Kill the process; called with the lock."""
        process, self._process, self._asked = self._process, None, None
        if process is not None:
            process.kill()
            process.join()

    def _read(self, process: Any, pipe: Any) -> None:
        """Deliver what the process sends, until it ends."""
        while True:
            try:
                question, answer = pipe.recv()
            except (EOFError, OSError):
                break
            if self._wanted(process, question, answer):
                self._deliver(question, answer)
        pipe.close()
        with self._lock:
            lost = self._asked if process is self._process else None
            if lost is not None:
                self._asked = self._process = None
        if lost is not None:
            self._deliver(lost, Failure(LOST))

    def _wanted(self, process: Any, question: Task, answer: Any) -> bool:
        """Whether somebody waits for an answer; its question is settled with the last one."""
        last = isinstance(answer, Done | Failure)
        with self._lock:
            if process is not self._process:
                return False
            if self._asked is None or question.number != self._asked.number:
                self._since = time.monotonic()
                return not last  # an older hop is shown too, so that a slider that is dragged shows what it passes
            if last:
                self._asked = None
            return True


class _Newest:
    """The newest question of a pipe. Its thread reads on while another computes, and ends the process as soon as the
    other end of the pipe is closed, also by the death of the server."""

    def __init__(self, pipe: Any):
        self._pipe, self._came, self._question = pipe, threading.Event(), None
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        try:
            while True:
                self._question = self._pipe.recv()
                self._came.set()
        except (EOFError, OSError):
            os._exit(0)

    def wait(self) -> Any:
        """The newest question, as soon as there is one that was not asked for before."""
        self._came.wait()
        self._came.clear()
        return self._question

    @property
    def waiting(self) -> bool:
        """Whether there is a newer question."""
        return self._came.is_set()


def answer_questions(pipe: Any, given: Any, calm: bool) -> None:
    """What a process does: answer the newest question, piece by piece, unless there is a newer one."""
    if calm and hasattr(os, "nice"):
        os.nice(10)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server heeds it, and ends this process
    newest = _Newest(pipe)
    while True:
        question = newest.wait()
        for answer in _answers(question, given):
            pipe.send((question, answer))
            if newest.waiting and not isinstance(answer, Done | Failure):
                break


def _answers(question: Task, given: Any) -> Iterator[Any]:
    """The answers to a question; an error that is raised on purpose is one in words."""
    try:
        yield from ANSWERS[question.name](given, *question.arguments)
    except OrbitsError as error:
        yield Failure(str(error))
    except MemoryError:
        yield Failure("there is not enough memory for this")
    except Exception as error:
        yield Failure(f"internal error, please report it: {type(error).__name__}: {error}")
    else:
        yield Done()
