"""Workers: the newest question wins, a stop kills, many at once answer alike, and none is left behind."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path
from queue import Queue

import pytest

from orbits import find, follow
from problems import Hopper

pytest.importorskip("bokeh")

from problems.explorer.answers import HopAnswer, family_answers, hop_answer, map_answers
from problems.explorer.scene import Scene, beginning
from problems.explorer.worker import Done, Failure, Task, Worker
from tests.browser import wait_for

pytestmark = pytest.mark.extra("bokeh")

ROOT = Path(__file__).parents[3]
CUBIC = beginning("hopper")
# The search for hops of a spring that bends everywhere takes minutes.
ENDLESS = Scene(spring="r + 0.02*sin(60*r)", numbers={"rest_length": 30.0}, family=40).complete()


@pytest.fixture
def made():
    """Makes workers with the queue of their answers, and closes them."""
    workers = []

    def new(**options):
        answers = Queue()
        workers.append(Worker(lambda question, answer: answers.put((question, answer)), **options))
        return workers[-1], answers

    yield new
    for worker in workers:
        worker.stop()


def hop(scene: Scene, with_dials: bool = False) -> Task:
    return Task("hop", (scene, with_dials))


def answered(answers: Queue, question: Task) -> list:
    """The answers that come until the last one to a question."""
    found = []
    while True:
        which, answer = answers.get(timeout=60)
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
    assert (answer.alpha, answer.admissible, answer.scene) == (orbit.alpha, True, CUBIC)
    assert answer.data.end == orbit.period
    assert worker.busy == 0.0


def test_the_newest_question_wins(made):
    worker, answers = made()
    worker.ask(first := hop(CUBIC))
    answered(answers, first)
    values = [0.3 + k / 1000 for k in range(400)]
    for value in values:
        worker.ask(last := hop(CUBIC.with_numbers(beta=value)))
    hops = [each for each in answered(answers, last) if isinstance(each, HopAnswer)]
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
    process, began = worker._process, time.monotonic()
    worker.stop()
    assert time.monotonic() - began < 2
    assert not is_alive(process.pid)
    assert worker.busy == 0.0
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


def test_a_new_question_ends_one_that_takes_long(made, monkeypatch):
    monkeypatch.setattr("problems.explorer.worker.IMPATIENT", 0.5)
    worker, answers = made()
    worker.ask(hop(ENDLESS))
    time.sleep(1.5)
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


def test_a_process_that_dies_is_told_and_replaced(made):
    worker, answers = made()
    worker.ask(question := hop(ENDLESS))
    time.sleep(1)
    os.kill(worker._process.pid, signal.SIGKILL)
    (failure,) = answered(answers, question)
    assert "has ended" in failure.reason
    worker.ask(question := hop(CUBIC))
    assert len(answered(answers, question)) == 2


def test_ten_do_not_disturb_each_other(made):
    """One computes for minutes, the others answer alike."""
    made()[0].ask(hop(ENDLESS))
    pairs = [made() for _ in range(9)]
    questions = [hop(CUBIC.with_numbers(beta=0.1 + k / 10)) for k in range(9)]
    for (worker, _), question in zip(pairs, questions, strict=True):
        worker.ask(question)
    for k, ((_, answers), question) in enumerate(zip(pairs, questions, strict=True)):
        answer, _ = answered(answers, question)
        orbit = find(Hopper("cubic", rest_length=8.0, parameters={"beta": 0.1 + k / 10}))
        assert answer.alpha == orbit.alpha


def test_workers_end_with_the_program_that_started_them(tmp_path):
    script = tmp_path / "killed.py"
    lines = """
        import os, signal, time
        from problems.explorer.scene import Scene
        from problems.explorer.worker import Task, Worker

        if __name__ == "__main__":
            worker = Worker(print)
            scene = Scene(spring="r + 0.02*sin(60*r)", numbers={"rest_length": 30.0}, family=40).complete()
            worker.ask(Task("hop", (scene, False)))
            time.sleep(1)
            print(worker._process.pid, flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
    """
    script.write_text(textwrap.dedent(lines), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, timeout=60)
    assert run.returncode == -signal.SIGKILL
    wait_for(lambda: not is_alive(int(run.stdout)), 10, "the worker ends")


def test_a_family_comes_in_pieces_and_is_that_of_follow():
    scene = replace(CUBIC, along="beta")
    pieces = list(family_answers(None, scene, -0.5, 2.0))
    assert len(pieces) > 3
    assert "still growing" in pieces[0].text
    assert list(pieces[0].data.events["kind"]) == []
    assert "up: reached" in pieces[-1].text
    assert "down: escaped" in pieces[-1].text
    assert list(pieces[-1].data.events["kind"])[-2:] == ["end: reached", "end: escaped"]
    assert list(pieces[-1].data.events["value"])[-2:] == [2.0, pieces[-1].values[0]]
    assert sum(kind.startswith("end: ") for kind in pieces[-1].data.events["kind"]) == 2
    values = pieces[-1].values
    assert values[-1] == 2.0
    down = follow(Hopper("cubic", rest_length=8.0), "beta", 2.0)
    for point in (down[0], down[-1]):
        place = pieces[-1].nearest(point.value, point.alpha)
        extension, alpha, duration = pieces[-1].starts[place]
        assert (values[place], alpha) == pytest.approx((point.value, point.alpha), rel=1e-9)
        assert (extension, duration) == pytest.approx((point.liftoff_extension, point.flight_time / 2), rel=1e-9)


def test_a_family_from_the_upper_end_of_its_slider_goes_down():
    *_, family = family_answers(None, replace(CUBIC, along="beta"), 0.1, CUBIC.numbers["beta"])
    assert "down: reached" in family.text
    assert "up" not in family.text


def test_a_point_beyond_a_fold_is_come_back_to():
    """Two hops have the same beta < 0: the start tells which is meant, and another slider keeps to its branch."""
    softening = replace(
        beginning("hopper"), numbers={"mass_ratio": 1.0, "rest_length": 30.0, "beta": 0.0}, along="beta"
    )
    *_, family = family_answers(None, softening, -0.02, 0.02)
    place = family.nearest(-0.005, 15.0)
    high = family.starts[place][1]
    scene = replace(softening.with_numbers(beta=family.values[place]), start=family.starts[place])
    (answer,) = hop_answer(None, scene, False)
    assert answer.alpha == pytest.approx(high, rel=1e-9)
    (moved,) = hop_answer(None, answer.scene.with_numbers(rest_length=29.0), False)
    assert moved.alpha == pytest.approx(high, rel=1e-6)  # constant gravity knows no rest length
    (other,) = hop_answer(None, replace(scene, start=None), False)
    assert other.alpha < 0.9 * high


def test_the_map_is_drawn_first_and_then_its_basin():
    first, second = map_answers(None, replace(beginning("juggler"), launch=4.6))
    assert first.basin is None
    assert first.web.shape[0] == 2
    assert first.web.shape[1] > 4
    assert 0 < second.share < 1
    again = list(map_answers(None, replace(beginning("juggler"), launch=4.7)))
    assert len(again) == 1  # another cobweb needs no other basin
    assert (again[0].basin == second.basin).all()
