"""Workers: the newest question wins, a stop kills, many at once answer alike, and none is left behind."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from queue import Queue

import pytest

from orbits import find
from problems import Hopper

pytest.importorskip("bokeh")

from problems.explorer import Scene, beginning
from problems.explorer.results import HopResult
from problems.explorer.worker import WORKERS, Done, Failure, Pool, Task, Worker
from tests.browser import PATIENCE, wait_for

pytestmark = pytest.mark.extra("bokeh")

ROOT = Path(__file__).parents[3]
CUBIC = beginning("hopper")
# The search for hops of a spring that bends everywhere takes minutes.
ENDLESS = Scene(spring="r + 0.02*sin(60*r)", numbers={"rest_length": 30.0}, family=40).complete()


@pytest.fixture
def made():
    """Makes workers with the queue of their answers, and closes them."""
    workers = []

    def new(pool=None):
        answers = Queue()
        workers.append(Worker(lambda question, answer: answers.put((question, answer)), pool or Pool()))
        return workers[-1], answers

    yield new
    for worker in workers:
        worker.close()


def hop(scene: Scene, with_dials: bool = False) -> Task:
    return Task("hop", (scene, with_dials))


def answered(answers: Queue, question: Task) -> list:
    """The answers that come until the last one to a question."""
    found = []
    while True:
        which, answer = answers.get(timeout=PATIENCE)
        found.append(answer)
        if which.number == question.number and isinstance(answer, Done | Failure):
            return found


def is_alive(pid: int) -> bool:
    """Whether a process is there and no corpse."""
    try:
        return ") Z" not in Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except OSError:
        return False


def test_a_hop_is_that_of_find(made):
    worker, answers = made()
    worker.ask(question := hop(CUBIC, True))
    dials, answer, end = answered(answers, question)
    orbit = find(Hopper("cubic", rest_length=8.0))
    assert isinstance(end, Done)
    assert [dial.name for dial in dials.dials] == ["mass_ratio", "rest_length", "beta", "restitution"]
    assert (answer.alpha, answer.violations, answer.scene) == (orbit.alpha, (), CUBIC)
    assert answer.data.end == orbit.period
    assert worker.busy == 0.0


def test_the_newest_question_wins(made):
    worker, answers = made()
    worker.ask(first := hop(CUBIC))
    answered(answers, first)
    values = [0.3 + k / 1000 for k in range(400)]
    for value in values:
        worker.ask(last := hop(CUBIC.with_numbers(beta=value)))
    hops = [each for each in answered(answers, last) if isinstance(each, HopResult)]
    assert hops[-1].scene.numbers["beta"] == values[-1]
    assert len(hops) < 200
    assert worker.busy == 0.0


def test_what_has_no_answer_is_said(made):
    worker, answers = made()
    worker.ask(question := hop(CUBIC.with_numbers(beta=-0.3)))
    (failure,) = answered(answers, question)
    assert isinstance(failure, Failure)
    assert "internal error" not in failure.reason
    worker.ask(question := hop(CUBIC.with_numbers(beta=-0.3), True))
    dials, failure = answered(answers, question)
    assert len(dials.dials) == 4  # the way back from a machine without a hop
    assert "internal error" not in failure.reason
    worker.ask(question := Task("hop", ("no scene", True)))
    (failure,) = answered(answers, question)
    assert failure.reason.startswith("internal error")
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


def test_a_stop_kills_at_once_and_the_next_question_is_answered(made):
    worker, answers = made()
    worker.ask(hop(ENDLESS))
    time.sleep(2)
    assert worker.busy > 1
    process = worker.process.process
    worker.stop()
    assert not is_alive(process.pid)
    assert worker.busy == 0.0
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


def test_a_new_question_ends_one_that_takes_long(made, monkeypatch):
    monkeypatch.setattr("problems.explorer.worker.WORKERS", WORKERS._replace(impatient=0.5))
    worker, answers = made()
    worker.ask(hop(ENDLESS))
    time.sleep(1.5)
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


@pytest.mark.posix
def test_a_process_that_dies_is_told_and_replaced(made):
    worker, answers = made()
    worker.ask(question := hop(ENDLESS))
    time.sleep(1)
    os.kill(worker.process.process.pid, signal.SIGKILL)
    (failure,) = answered(answers, question)
    assert "has ended" in failure.reason
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


def test_no_process_is_left_without_workers(made):
    pool = Pool(size=2)
    pairs = [made(pool) for _ in range(3)]
    questions = [hop(CUBIC.with_numbers(beta=0.1 + k / 10)) for k in range(3)]
    for (worker, _), question in zip(pairs, questions, strict=True):
        worker.ask(question)
    assert len(pool._processes) == 2
    for (_, answers), question in zip(pairs, questions, strict=True):
        answered(answers, question)
    processes = [each.process for each in pool._processes]
    pairs[0][0].close()
    assert len(pool._processes) == 2
    for worker, _ in pairs[1:]:
        worker.close()
    assert not pool._processes
    assert not any(is_alive(process.pid) for process in processes)


def test_a_process_that_has_grown_is_replaced(made, monkeypatch):
    monkeypatch.setattr("problems.explorer.worker.WORKERS", WORKERS._replace(memory=1 << 20))
    worker, answers = made(pool := Pool())
    for _ in range(2):
        worker.ask(question := hop(CUBIC))
        assert len(answered(answers, question)) == 2
        wait_for(lambda: not pool._processes, "the process ends")


@pytest.mark.slow
@pytest.mark.posix
def test_workers_end_with_the_program_that_started_them(tmp_path):
    script = tmp_path / "killed.py"
    lines = """
        import os, signal, time
        from problems.explorer.scene import Scene
        from problems.explorer.worker import Pool, Task, Worker

        if __name__ == "__main__":
            worker = Worker(print, Pool())
            scene = Scene(spring="r + 0.02*sin(60*r)", numbers={"rest_length": 30.0}, family=40).complete()
            worker.ask(Task("hop", (scene, False)))
            time.sleep(1)
            print(worker.process.process.pid, flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
    """
    script.write_text(textwrap.dedent(lines), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, timeout=PATIENCE)
    assert run.returncode == -signal.SIGKILL
    wait_for(lambda: not is_alive(int(run.stdout)), "the worker ends")
