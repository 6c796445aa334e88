"""What a page tells its tab, its workers replaced by ones that answer at once or when they are let go."""

import json
from dataclasses import replace

import pytest

pytest.importorskip("bokeh")

from bokeh.document import Document

from orbits import find
from problems import Hopper
from problems.explorer import Scene, beginning
from problems.explorer.page import Explorer
from problems.explorer.results import RESULTS as ON_PAGE
from problems.explorer.worker import _results_of

pytestmark = pytest.mark.extra("bokeh")

SOFTENING = replace(beginning("hopper"), numbers={"mass_ratio": 1.0, "rest_length": 30.0, "beta": -0.008}, along="beta")


RESULTS: dict[str, list] = {}


def results(question) -> list:
    """The results of a task; tasks that are the same but for their numbers have the same ones."""
    key = repr((question.name, question.arguments))
    if key not in RESULTS:
        RESULTS[key] = list(_results_of(question, None))
    return RESULTS[key]


class Inline:
    """A worker in this process; while it is `held` it keeps what it was asked, until it is let go."""

    def __init__(self, came):
        self.came, self.held, self.kept, self.asked = came, False, [], 0

    def ask(self, question):
        self.asked += 1
        self.kept = [question]
        if not self.held:
            self.let_go()

    def let_go(self, pieces: int | None = None):
        """Deliver what was asked, or only so many of its answers."""
        for question in self.kept:
            for _, answer in zip(range(pieces or 10_000), results(question), strict=False):
                self.came(question, answer)

    def stop(self):
        self.kept = []

    close = stop


class Tab:
    """A page and what its tab sends and sees."""

    def __init__(self, scene: Scene):
        self.page, self.n = Explorer(Document(), scene), 0
        self.workers = self.page._workers

    def ask(self, act: str, **rest) -> dict:
        self.n += 1
        self.page._receive(json.dumps({"n": self.n, "act": act, **rest}))
        return self.told

    def rest(self) -> dict:
        """What it is told once nothing has changed for a while, so that the family and the map are there."""
        self.page._compute_surroundings()
        return self.told

    @property
    def told(self) -> dict:
        return json.loads(self.page._bridge.page_state)

    @property
    def alpha(self) -> float:
        return self.page._computed.hop.alpha


@pytest.fixture
def tab(monkeypatch):
    monkeypatch.setattr(Explorer, "_worker", lambda self, came, calm=False: Inline(came))
    few = ON_PAGE._replace(family=70)  # it has come back from its fold
    monkeypatch.setattr("problems.explorer.results.RESULTS", few)
    return Tab


def test_a_picture_of_other_numbers_is_dimmed_beside_the_verdict(tab):
    page = tab(beginning("juggler"))
    assert (page.told["verdict"], page.told["stale"]) == ("yes", [])
    told = page.ask("number", name="mass_ratio", value=-1.0)
    assert told["verdict"] == "no"
    assert {"machine", "heights", "portrait", "force"} <= {*told["stale"]}
    assert "mass_ratio" in told["problems"]["page"]
    told = page.ask("spring", value="r +")  # no scene, so that the last one stands
    assert "r +" in told["problems"]["spring"]
    told = page.ask("number", name="mass_ratio", value=2.0)
    assert (told["verdict"], told["stale"], told["problems"]) == ("yes", [], {})
    assert told["status"].startswith("A motion without loss: the ball is thrown")


@pytest.mark.slow
def test_the_slider_goes_through_a_fold_from_hop_to_hop(tab):
    page = tab(SOFTENING)
    told = page.rest()
    first, key, lowest = told["place"]["at"], told["place"]["key"], page.alpha
    assert 10 < first < told["place"]["of"]
    launches = []
    for place in [*range(first, 0, -8), 0]:
        told = page.ask("place", value=place, key=key)
        assert (told["place"]["at"], told["problems"]) == (place, {})
        launches.append(page.alpha)
    assert launches == sorted(launches)  # along the curve the launch speed grows, before the fold and beyond it
    values = page.page._computed.family.values
    assert min(values) < values[first]
    assert values[0] > values[first]  # the curve has turned round
    assert lowest < find(Hopper("cubic", rest_length=30.0, parameters={"beta": min(values)})).alpha < launches[-1]


@pytest.mark.parametrize("along", ["mass_ratio", "rest_length"])
@pytest.mark.slow
def test_hops_of_one_launch_speed_are_told_apart(tab, along):
    page = tab(replace(beginning("hopper"), along=along))
    told = page.rest()
    for place in range(0, told["place"]["of"], 9):
        assert page.ask("place", value=place, key=told["place"]["key"])["place"]["at"] == place


@pytest.mark.slow
def test_the_place_that_is_asked_for_is_told_at_once(tab):
    page = tab(SOFTENING)
    told = page.rest()
    page.workers["hop"].held = True
    asked = told["place"]["at"] + 4
    told = page.ask("place", value=asked, key=told["place"]["key"])
    assert (told["idle"], told["place"]["at"]) == (False, asked)
    page.workers["hop"].let_go()
    assert (page.told["idle"], page.told["place"]["at"]) == (True, asked)


def test_a_place_of_a_piece_is_taken_after_the_family_has_grown(tab):
    page = tab(SOFTENING)
    page.workers["family"].held = True
    page.rest()
    page.workers["family"].let_go(pieces=1)
    piece = page.page._computed.family
    early = page.told["place"]
    page.workers["family"].let_go()
    told = page.ask("place", value=2, key=early["key"])
    assert told["place"]["of"] > early["of"]
    assert page.alpha == pytest.approx(piece.starts[2][1], rel=1e-9)


def test_a_place_that_is_none_changes_nothing(tab):
    page = tab(SOFTENING)
    told, alpha = page.rest(), page.alpha
    for value in (True, 1.0, -1, 10_000, "1", None, [1]):
        assert page.ask("place", value=value, key=told["place"]["key"])["scene"] == told["scene"], value
    assert page.ask("place", value=1, key="0 0")["scene"] == told["scene"]
    page.ask("along", value="mass_ratio")
    assert page.ask("place", value=1, key=told["place"]["key"])["place"] != told["place"]
    assert page.alpha == alpha  # the place was one of another family


def test_what_comes_after_a_page_was_left_is_not_shown(tab):
    page = tab(SOFTENING)
    page.rest()
    worker, kept = page.workers["hop"], page.alpha
    worker.held = True
    page.ask("number", name="beta", value=-0.004)
    question = worker.kept[0]
    page.page._receive(json.dumps({"n": page.n, "act": "leave"}))
    asked = {name: each.asked for name, each in page.workers.items()}
    for answer in _results_of(question, None):  # it was on its way
        worker.came(question, answer)
    assert (page.alpha, page.page._pending) == (kept, None)
    assert {name: each.asked for name, each in page.workers.items()} == asked


@pytest.mark.parametrize("text", ["nonsense", "[]", '{"act": "stop"}', '{"n": 1e999, "act": "stop"}', "[" * 100_000])
def test_a_tab_that_sends_what_no_page_sends_computes_nothing_more(tab, text):
    page = tab(SOFTENING)
    asked = page.workers["hop"].asked
    page.page._receive(text)
    page.ask("number", name="beta", value=-0.004)
    assert page.workers["hop"].asked == asked


@pytest.mark.slow
def test_a_page_that_comes_back_computes_again(tab):
    page = tab(SOFTENING)
    page.workers["family"].held = True
    page.rest()
    page.workers["family"].let_go(pieces=1)
    assert "still growing" in page.told["family-text"]
    page.ask("leave")
    page.workers["family"].held = False
    told = page.ask("number", name="beta", value=-0.004)
    assert told["idle"]
    assert "still growing" not in page.rest()["family-text"]
