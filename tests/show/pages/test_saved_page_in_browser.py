"""Still pages in a real browser: they are drawn where they should be, move, stop, tell, and load nothing."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import Page, chromium, wait_for

from orbits import bifurcations, find, follow, simulate, sweep
from problems import Hopper, hopper_in_si

pytest.importorskip("bokeh")

from PIL import Image

from orbits.show import COLOURS, spread
from orbits.show.pages.saved_page import MOST_HOPS

pytestmark = pytest.mark.browser
SIZES = (1200, 400)
# The figure with a title or else a vertical axis of this name, and where in the window a place of its axes is.
FIND = """
const figures = Bokeh.documents.flatMap(d => [...d._all_models.values()]).filter(m => m.type == "Figure");
const figure = figures.find(f => (f.title.text || f.left[0].axis_label) == arguments[0]);
const view = Bokeh.index.find_one(figure);
"""
ONLY = 'const [figure] = [...Bokeh.documents[0]._all_models.values()].filter(m => m.type == "Figure");'
PLACE = """
view.el.scrollIntoView({block: "center"});
const at = (view.canvas_view ?? view.canvas).el.getBoundingClientRect();
return [at.left + view.frame.x_scale.compute(arguments[1]), at.top + view.frame.y_scale.compute(arguments[2])];
"""
# What is written in tooltips, wherever they are in the shadows of the page, and where they end on both sides.
TOOLTIPS = """
const found = [], seen = [document.body];
while (seen.length) {
  const element = seen.pop(), inner = [...(element.shadowRoot?.children ?? []), ...element.children];
  if (element.classList?.contains("bk-Tooltip")) {
    const text = inner.filter(child => child.tagName != "STYLE").map(child => child.innerText).join(" ");
    const {left, right} = element.getBoundingClientRect();
    if (text.trim()) found.push([text, left, right]);
  }
  seen.push(...inner);
}
return found[0];
"""
MODEL = "[...Bokeh.documents[0]._all_models.values()].find(m => m.name == arguments[0])"


@pytest.fixture(scope="module")
def page():
    with chromium() as page:
        yield page


@pytest.fixture(scope="module")
def orbit():
    return find(hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0))


@pytest.fixture(scope="module")
def hop(orbit, tmp_path_factory):
    return orbit.page(tmp_path_factory.mktemp("pages") / "hop.html")


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    family = follow(Hopper("cubic", rest_length=30), "beta", stop=-0.004, start=0.0)
    return family, family.page(tmp_path_factory.mktemp("pages") / "family.html")


def body_of(orbit):
    """The body's height as a function of the state."""
    return orbit.shape.heights["body"]


def opened(page: Page, path, width: int, figures: int, moving: bool = False) -> None:
    """Open a page that must fit its width, load nothing but itself, and not be blank. Unless it is to be `moving` the
    reader wants less motion."""
    page.resize(width)
    page.prefer(less_motion=not moving)
    before = len(page.requests())
    page.open(path)
    page.wait_for_figures(figures)
    page.wait("return document.documentElement.scrollWidth <= arguments[0]", width)
    assert page.run("return document.title + document.documentElement.lang").endswith("en")
    assert [url for url in page.requests()[before:] if not url.startswith("file://")] == []
    assert len(page.requests()) == before + 1
    wait_for(lambda: len(np.unique(page.picture() @ np.array([1, 256, 65536]))) > 20, "it is not blank")


def seen(page: Page, title: str) -> np.ndarray:
    """A picture of a figure."""
    element = page.run(f"{FIND} view.el.scrollIntoView({{block: 'center'}}); return view.el", title)
    return np.array(Image.open(io.BytesIO(element.screenshot_as_png)).convert("RGB"), dtype=int)


def wait_for_colour(page: Page, title: str, x: float, y: float, colour: str) -> tuple[float, float]:
    """Wait until a colour is seen near a place of a figure; where in the window that is."""

    def seen_there() -> tuple[float, float] | None:
        place = page.run(FIND + PLACE, title, x, y)
        return place if colour_near(page, place, colour) else None

    return wait_for(seen_there, f"{colour} is seen in '{title}' at {x}, {y}")


def colour_near(page: Page, place: tuple[float, float], colour: str) -> bool:
    """Whether there is a pixel of a colour within three pixels of a place in the window."""
    x, y = (round(value) for value in place)
    around = page.picture()[y - 3 : y + 4, x - 3 : x + 4].astype(int)
    rgb = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return bool((np.abs(around - rgb).max(axis=2) < 30).any())


@pytest.mark.parametrize("width", SIZES)
def test_a_hops_curves_are_where_they_should_be(page, hop, orbit, width):
    opened(page, hop, width, 5)
    t = np.linspace(0, orbit.period, 4001)
    for i, (name, height) in enumerate(list(orbit.shape.heights.items())[:2]):
        values = height(orbit(t))
        highest = int(values.argmax())
        place = wait_for_colour(page, "Heights", t[highest], values[highest], COLOURS[i])
        assert not colour_near(page, (place[0], place[1] - 12), COLOURS[i]), name
    force = orbit.contact_force(t)
    wait_for_colour(page, "Contact force", t[force.argmax()], force.max(), "#333333")


@pytest.mark.parametrize("width", SIZES)
def test_a_hop_moves_and_stops(page, hop, width):
    opened(page, hop, width, 5, moving=True)
    first = seen(page, "height (m)")
    wait_for(lambda: (np.abs(seen(page, "height (m)") - first) > 60).any(axis=2).sum() > 100, "it has moved")
    page.run(f"{MODEL}.active = false", "play")
    wait_for(lambda: np.array_equal(*(seen(page, "height (m)") for _ in range(2))), "it has stopped")
    at = page.run(f"return {MODEL}.value", "place")
    page.run("return new Promise(done => setTimeout(done, 400))")
    assert page.run(f"return {MODEL}.value", "place") == at
    assert page.run(f"return {MODEL}.label", "play") == "Play"


def test_the_machine_is_drawn_at_the_heights_of_its_place(page, hop, orbit):
    opened(page, hop, 1200, 5, moving=True)
    page.run(f"{MODEL}.value = arguments[1]", "place", 0.25)
    body = float(body_of(orbit)(orbit(0.25 * orbit.period)))
    wait_for_colour(page, "height (m)", 0.0, body, COLOURS[0])
    assert not page.run(f"return {MODEL}.active", "play")
    x = page.run("return [...Bokeh.documents[0]._all_models.values()].find(m => m.data?.aside).data.y[0]")
    assert x == pytest.approx(body, abs=1e-4)


def test_a_hop_rests_for_a_reader_who_wants_less_motion(page, hop):
    opened(page, hop, 1200, 5)
    page.run("return new Promise(done => setTimeout(done, 400))")
    assert page.run(f"return [{MODEL}.active, {MODEL}.label]", "play") == [False, "Play"]
    assert page.run(f"return {MODEL}.value", "place") == 0


def test_an_animation_tells_a_server_nothing(page, hop):
    """Each frame would be a message over the wire, to every page that is open."""
    opened(page, hop, 1200, 5, moving=True)
    page.run("window.told = 0; Bokeh.documents[0].on_change(event => {if (event.sync) window.told += 1})")
    first = page.run(f"return {MODEL}.value", "place")
    page.wait(f"return Math.abs({MODEL}.value - arguments[1]) > 0.1", "place", first)
    assert page.run("return window.told") == 0


def told_at(page: Page, title: str, x: float, y: float, width: int) -> str:
    """What a tooltip within the page says of a place of a figure."""
    from selenium.webdriver.common.actions.action_builder import ActionBuilder

    left, top = page.run(FIND + PLACE, title, x, y)

    def text_at_pointer() -> str | None:
        """What it says once the pointer has moved, which a page that is being drawn misses."""
        pointer = ActionBuilder(page.driver)
        pointer.pointer_action.move_to_location(round(left), round(top)).move_to_location(round(left) + 1, round(top))
        pointer.perform()
        text, start, end = page.run(TOOLTIPS) or ("", 0, 0)
        return text if 0 <= start < end <= width else None

    return wait_for(text_at_pointer, "a tooltip is shown within the page")


def numbers_in(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"[-.e0-9]*[0-9]", text)]


@pytest.mark.parametrize("width", SIZES)
def test_a_curve_tells_its_numbers(page, hop, orbit, width):
    opened(page, hop, width, 5)
    t = 0.4 * orbit.flight_time
    body = float(body_of(orbit)(orbit(t)))
    told = told_at(page, "Heights", t, body, width)
    assert numbers_in(told.split("foot")[0].partition("body")[2]) == pytest.approx([t, body], abs=0.01)


@pytest.mark.parametrize("width", SIZES)
def test_a_simulation_tells_its_numbers_and_zooms(page, tmp_path, width):
    run = simulate(Hopper(restitution=0.5), 4.7, hops=2)
    opened(page, run.page(tmp_path / "run.html"), width, 1)
    t = 0.3 * run.end
    body = float(run.heights["body"](run(t)))
    title = page.run(ONLY + "return figure.title.text")
    told = told_at(page, title, t, body, width)
    assert numbers_in(told.partition("body")[2]) == pytest.approx([t, body], rel=0.02)
    assert "WheelZoomTool" in page.run(ONLY + "return figure.toolbar.tools.map(tool => tool.type)")


def test_a_diagram_is_as_wide_as_its_page(page, tmp_path):
    diagram = bifurcations(Hopper(), "inject", (0.0, 0.1), (4.4, 4.7), sections=2)
    opened(page, diagram.page(tmp_path / "diagram.html"), 1200, 1)
    assert page.run(ONLY + "return Bokeh.index.find_one(figure).el.getBoundingClientRect().width") > 1000


def test_the_table_of_a_family_is_whole(page, followed):
    """Its last column says why there is no motion."""
    opened(page, followed[1], 1200, 4)
    for table in page.driver.find_elements("css selector", ".table"):
        assert page.run("return arguments[0].scrollWidth <= arguments[0].clientWidth", table)


def contrast(one: np.ndarray, other: np.ndarray) -> float:
    """The contrast of two colours from 0 to 255, as the guidelines for accessible pages (WCAG 2) define it."""
    shares = np.array([one, other]) / 255
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    low, high = sorted(linear @ [0.2126, 0.7152, 0.0722])
    return float((high + 0.05) / (low + 0.05))


def inverted(colour: np.ndarray) -> np.ndarray:
    """What the filters invert(.9) and hue-rotate(180deg) make of a colour, by the matrices of the CSS specification."""
    light = np.array([0.213, 0.715, 0.072])
    return (2 * np.outer(np.ones(3), light) - np.eye(3)) @ (0.9 * 255 - 0.8 * colour)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_page_is_light_or_dark_as_its_reader_prefers(page, hop, dark):
    """Page and figures have one ground; texts and curves stand out from it, and so does the sample of a pale area."""
    page.resize(1200)
    page.prefer(dark=dark)
    page.open(hop)
    page.wait_for_figures(5)
    ground = page.picture()[5, 5]
    assert (ground.mean() < 60) == dark
    heights = seen(page, "Heights")
    assert np.abs(heights[2, 2] - ground).max() <= 2
    colours = np.unique(heights.reshape(-1, 3), axis=0)
    assert max(contrast(colour, ground) for colour in colours) > 7
    text = page.run("return getComputedStyle(document.querySelector('td')).color")
    assert contrast(np.array(numbers_in(text)[:3]), ground) > 7
    edge = np.array([0x9A, 0x93, 0x7C])
    edge = inverted(edge) if dark else edge
    assert contrast(edge, ground) > 3
    assert (np.abs(heights - edge).max(axis=2) < 12).sum() > 20
    page.prefer()


def clicked(page: Page, point, quantity: str, before: int) -> int:
    """The number of the hop that is shown after a click at a point of a family; another one was shown before."""
    from selenium.webdriver.common.actions.action_builder import ActionBuilder

    x, y = page.run(FIND + PLACE, quantity.replace("_", " "), point.value, getattr(point, quantity))
    pointer = ActionBuilder(page.driver)
    pointer.pointer_action.move_to_location(round(x), round(y)).click()
    pointer.perform()
    return page.wait(f"const at = {MODEL}.value; return at != arguments[1] && [at]", "hop", before)[0]


@pytest.mark.parametrize("width", SIZES)
def test_a_hop_of_a_family_is_chosen(page, followed, width):
    family, path = followed
    opened(page, path, width, 4)
    heights = "[...Bokeh.documents[0]._all_models.values()].find(m => m.data?.speed && !m.data.aside).data.height[0]"
    before = page.run(f"return Math.max(...{heights})")
    last = page.run(f"const slider = {MODEL}; slider.value = slider.end; return slider.end", "hop")
    assert page.wait(f"const top = Math.max(...{heights}); return top > arguments[0] && top", before)
    chosen = clicked(page, family[len(family) // 2], "alpha", last)
    assert 0 < chosen < last
    wait_for_colour(page, "alpha", family[0].value, family[0].alpha, COLOURS[0])


def test_a_click_where_some_hops_do_not_have_the_quantity(page, tmp_path):
    """Beyond the collapse the contact never ends and has no time; a click finds the nearest hop of the others."""
    family = follow(Hopper("cubic", rest_length=30), "beta", stop=-0.02, start=0.0)
    assert np.isnan(family.column("contact_time")).any()
    opened(page, family.page(tmp_path / "folded.html", "contact_time"), 1200, 4)
    hops = spread(family, MOST_HOPS)
    assert clicked(page, hops[2], "contact_time", 0) == 2


def test_a_page_loads_nothing_for_texts_with_mathematics(page, tmp_path, orbit):
    """Bokeh loads a script from elsewhere for texts with TeX in them, as a file may have them."""
    words = replace(orbit, machine={**orbit.machine, "spring": "$$x^2$$", "machine": r"\(a\)"})
    opened(page, words.page(tmp_path / "hop.html"), 1200, 4)


@pytest.mark.parametrize("width", SIZES)
def test_members_of_a_sweep_are_where_they_should_be(page, tmp_path, width):
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [0.0, 0.05, 0.1]})
    opened(page, swept.page(tmp_path / "sweep.html"), width, 1)
    for beta, alpha in zip(swept["beta"].tolist(), swept["alpha"].tolist(), strict=True):
        wait_for_colour(page, "alpha", beta, alpha, COLOURS[0])
