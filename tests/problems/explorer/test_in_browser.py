"""The page in a real browser: sliders moved, formulas typed, points clicked, links followed, rows dropped."""

from pathlib import Path
from urllib.parse import urljoin, urlsplit

import numpy as np
import pytest

pytest.importorskip("bokeh")

from orbits import find, follow
from orbits.show import COLOURS
from problems import Hopper, rimless_wheel, rocking_block, runner
from problems.explorer.forms import scene_of_link
from problems.laws import springs
from tests.browser import Page, chromium, wait_for
from tests.problems.explorer.scenes import arguments
from tests.problems.explorer.served import descendants, served

pytestmark = pytest.mark.browser
SETTLED = "return window.explorer && explorer.settled"
# A figure is laid out and painted in the frame after it is let go.
TWO_FRAMES = """
    const done = arguments[0];
    requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done)));
"""
# What is dimmed: figures, the lines below them, and the certificate.
DIMMED = """
    const named = each => each.dataset.figure ?? each.dataset.caption ?? each.id.replace(/-fold$/, "");
    return [...document.querySelectorAll(".stale")].map(named);
"""
ENDLESS = "r + 0.02*sin(60*r)"


@pytest.fixture(scope="module")
def address():
    with served() as (where, _):
        yield where


@pytest.fixture(scope="module")
def browser(address):  # it ends before the server does, which it would miss
    with chromium() as page:
        page.open(urljoin(address, "/static/js/bokeh.min.js"))  # of the same origin, and nothing is computed for it
        page.run("localStorage.setItem('tour', 'seen')")
        yield page


@pytest.fixture
def tab(browser: Page):
    """The browser for a test that opens the page itself, at another address or with another tour."""
    browser.resize(1200)
    yield browser
    assert browser.errors() == []
    hosts = {urlsplit(url).hostname for url in browser.requests()}
    assert hosts <= {"localhost", ""}  # nothing comes from elsewhere


@pytest.fixture
def page(tab: Page, address: str) -> Page:
    """The page with what it begins with, drawn."""
    tab.open(address)
    shown(tab)
    return tab


def shown(page: Page) -> float:
    """Wait until the page shows what was asked for; the hop's alpha as it is shown."""
    page.wait(SETTLED)
    return alpha_of(page)


def alpha_of(page: Page) -> float:
    """The launch speed in the table of the certificate."""
    text = page.run("return document.querySelector('#certificate td').textContent")
    return float(text.split(" ")[0])


def element(page: Page, name: str):
    """An element of the page, which may be written anew just now."""
    page.wait("return document.getElementById(arguments[0])", name)
    return page.driver.find_element("id", name)


def type_in(page: Page, name: str, text: str) -> None:
    """Replace the text of a field and leave it."""
    element(page, name).send_keys("\ue009a\ue000", text, "\t")  # Ctrl-A marks what is there


def problem(page: Page, where: str = "problem") -> str:
    return page.run("return document.getElementById(arguments[0]).textContent", where)


def cubic(beta: float, **others) -> float:
    """The launch speed of the hop that the page begins with, for another spring."""
    return find(Hopper("r + beta*r**3", rest_length=8.0, parameters={"beta": beta}), **others).alpha


def seen(page: Page, name: str) -> None:
    """Scroll to a figure, and wait until it is let go, as what is not seen is not drawn."""
    page.run("Bokeh.index.get(explorer.figures[arguments[0]]).el.scrollIntoView({block: 'center'})", name)
    page.wait("return !explorer.figures[arguments[0]].hold_render", name)
    page.driver.execute_async_script(TWO_FRAMES)


def wait_for_curve(page: Page) -> None:
    """Wait until the height of the body is drawn where it should be."""
    wait_for(lambda: curve_is_drawn(page), "the height of the body is drawn where it should be")


def curve_is_drawn(page: Page) -> bool:
    """Whether the height of the body is drawn where it should be: its colour is in the picture at a time in flight."""
    seen(page, "heights")
    x, y = page.run("""
        const figure = explorer.figures.heights, view = Bokeh.index.get(figure), frame = view.frame.bbox;
        const masses = figure.renderers.map(r => r.data_source).find(s => s.data.colour && s.data.height[0]?.length);
        const k = Math.floor(masses.data.time[0].length * 0.3), {left, top} = view.el.getBoundingClientRect();
        const share = (range, value) => (value - range.start) / (range.end - range.start);
        return [left + frame.left + frame.width * share(figure.x_range, masses.data.time[0][k]),
                top + frame.top + frame.height * (1 - share(figure.y_range, masses.data.height[0][k]))];
    """)
    colour = np.array([int(COLOURS[0][i : i + 2], 16) for i in (1, 3, 5)])
    around = page.picture()[int(y) - 4 : int(y) + 5, int(x) - 4 : int(x) + 5].astype(int)
    return bool((np.abs(around - colour).max(axis=2) < 60).any())


def wait_for_figure(page: Page, name: str) -> None:
    """Wait until a figure is drawn."""
    wait_for(lambda: is_not_blank(page, name), f"the figure '{name}' is drawn")


def is_not_blank(page: Page, name: str) -> bool:
    """Whether a figure has colours beside its white."""
    seen(page, name)
    box = page.run("""
        const el = Bokeh.index.get(explorer.figures[arguments[0]]).el;
        const {left, top, width, height} = el.getBoundingClientRect();
        return [left, top, width, height];
    """, name)  # fmt: skip
    left, top, width, height = map(int, box)
    part = page.picture()[max(top, 0) : top + height, max(left, 0) : left + width]
    return width > 200 and len(np.unique(part.reshape(-1, 3), axis=0)) > 20


def test_the_first_picture_is_the_hop_of_find_and_every_figure_is_drawn_at_both_widths(page):
    assert alpha_of(page) == pytest.approx(cubic(0.3), rel=1e-6)
    page.wait("return explorer.state['map-text'].includes('%')")
    page.wait("return /Upward|Downward/.test(explorer.state['family-text'])")
    for width in (1200, 400):
        page.resize(width)
        for name in ("machine", "heights", "portrait", "force", "law", "family", "map"):
            wait_for_figure(page, name)
        wait_for_curve(page)
        page.wait("return document.documentElement.scrollWidth <= arguments[0]", width)


def test_a_slider_moved_by_keyboard_shows_the_hop_there(page):
    slider = element(page, "slider-beta")
    slider.send_keys("\ue014" * 8)  # arrow to the right
    alpha, told = shown(page), page.run("return explorer.state.dials.find(d => d.name == 'beta').value")
    assert told > 0.3
    assert alpha == pytest.approx(cubic(told), rel=1e-6)
    assert float(element(page, "number-beta").get_attribute("value")) == told
    wait_for_curve(page)
    type_in(page, "number-beta", "3.5")  # beyond the slider's end
    assert shown(page) == pytest.approx(cubic(3.5), rel=1e-6)


def test_a_formula_is_typed_and_a_bad_one_leaves_the_hop(page):
    type_in(page, "spring", "tanh(b*r)/b")
    alpha = shown(page)
    machine = Hopper("tanh(b*r)/b", rest_length=8.0, parameters={"b": 0.1})
    assert alpha == pytest.approx(find(machine).alpha, rel=1e-6)
    for text, said in (("tanh(b*r)/", "tanh(b*r)/"), ("__import__('os')", "os"), ("table:/etc/passwd", "drop its")):
        type_in(page, "spring", text)
        assert shown(page) == alpha
        assert said in problem(page, "spring-problem")
        assert element(page, "spring").get_attribute("value") == text  # it stays, to be mended
        assert element(page, "spring").get_attribute("aria-invalid") == "true"
    type_in(page, "gravity", "exp(-z/H)")
    machine = Hopper("tanh(b*r)/b", "exp(-z/H)", rest_length=8.0, parameters={"b": 0.1, "H": 100.0})
    assert shown(page) == pytest.approx(find(machine).alpha, rel=1e-6)
    type_in(page, "gravity", "z")
    shown(page)
    assert "must be 1" in problem(page, "gravity-problem")


def test_without_a_hop_the_last_one_stands_and_undo_leads_back(page):
    before = alpha_of(page)
    type_in(page, "number-beta", "-0.4")
    assert shown(page) == before
    assert problem(page)
    assert {"machine", "title", "certificate", "heights"} <= {*page.run(DIMMED)}
    page.run("explorer.ask('along', {value: 'mass_ratio'})")
    assert shown(page) == before
    assert problem(page)  # it stays until there is a hop, whatever else is changed
    element(page, "undo").click()
    shown(page)
    assert problem(page) == ""
    assert "certificate" not in page.run(DIMMED)
    type_in(page, "number-beta", "0.9")
    assert shown(page) != before
    page.driver.find_element("tag name", "body").send_keys("\ue009z")  # Ctrl-Z
    page.wait("return explorer.settled && explorer.state.dials.find(d => d.name == 'beta').value == 0.3")
    assert alpha_of(page) == before


def test_what_is_being_typed_is_not_overwritten(page):
    """A message that comes meanwhile, as of the family or of another field, tells the old number again."""
    element(page, "number-beta").send_keys("\ue009a\ue000", "0.7")  # not left yet
    page.run("explorer.ask('along', {value: 'mass_ratio'})")
    shown(page)
    assert element(page, "number-beta").get_attribute("value") == "0.7"
    element(page, "number-beta").send_keys("\t")
    assert shown(page) == pytest.approx(cubic(0.7), rel=1e-6)


def test_a_family_and_a_machine_are_chosen(page):
    page.run("const s = document.getElementById('family'); s.value = '3'; s.dispatchEvent(new Event('change'))")
    assert shown(page) == pytest.approx(cubic(0.3, family=3), rel=1e-6)
    page.run("const s = document.getElementById('machine'); s.value = 'juggler'; s.dispatchEvent(new Event('change'))")
    assert shown(page) == pytest.approx(4.493409457909064, rel=1e-6)  # alpha = tan(alpha)


def click(page: Page, name: str, x: float, y: float) -> None:
    """Click at a place of a figure, in its own coordinates."""
    from selenium.webdriver import ActionChains

    seen(page, name)
    el, dx, dy = page.run("""
        const [name, x, y] = arguments, figure = explorer.figures[name], view = Bokeh.index.get(figure);
        const box = view.el.getBoundingClientRect(), frame = view.frame.bbox;
        const share = (range, value) => (value - range.start) / (range.end - range.start);
        return [view.el, frame.left + frame.width * share(figure.x_range, x) - box.width / 2,
                frame.top + frame.height * (1 - share(figure.y_range, y)) - box.height / 2];
    """, name, x, y)  # fmt: skip
    ActionChains(page.driver).move_to_element_with_offset(el, round(dx), round(dy)).click().perform()


def paths_in_plane(page: Page, place: float) -> list[np.ndarray]:
    """The outlines (2, m) that the animation shows at a place in the cycle, and the path behind it, at one instant."""
    return [
        np.array(path)
        for path in page.run(
            """
            Bokeh.documents.map(d => d.get_model_by_name("place")).find(s => s).value = arguments[0];
            const lines = explorer.figures.machine.renderers.map(r => r.data_source.data);
            const {xs, ys} = lines.find(data => data.size && data.closed);
            return xs.map((_, i) => [xs[i], ys[i]]);
            """,
            place,
        )
    ]


PLACES = (0.0, 0.003, 0.2581, 0.5, 0.7777, 0.999)  # in a cycle; most of them between two samples


def test_a_wheel_walks_in_the_plane(tab, address):
    """Its hub keeps the length of a spoke from the foot on which it stands, and a friction that it lacks is told."""
    tab.open(address + "?machine=wheel&si=1&spring=stiffness*r&p.friction=0.3")
    wheel = rimless_wheel(2.0, 0.4, 8, 0.5, 0.5, 20.0)
    assert shown(tab) == pytest.approx(find(wheel).alpha, rel=1e-6)
    needed = find(wheel).certificate.friction_needed
    assert f"No motion: it needs the friction coefficient {needed:.6g}" in element(tab, "status").text
    assert not element(tab, "drop").is_displayed()
    tab.resize(400)
    wait_for_figure(tab, "machine")
    for place in PLACES:
        *spokes, body, path = paths_in_plane(tab, place)
        assert len(spokes) == 8
        assert min(y[1] for _, y in spokes) == pytest.approx(0, abs=1e-6)
        assert path[:, -1] == pytest.approx(spokes[0][:, 0], abs=1e-5)  # the path ends at the hub
        assert path[1].max() == pytest.approx(0.4, rel=1e-3)
        assert body[1].mean() == pytest.approx(spokes[0][1][0], rel=1e-6)
    tab.run("const s = document.getElementById('machine'); s.value = 'rocker'; s.dispatchEvent(new Event('change'))")
    assert shown(tab) == pytest.approx(find(rocking_block(angle=0.3)).alpha, rel=1e-6)


def test_a_runner_runs_at_the_speed_of_its_slider(tab, address):
    """Its numbers are tuned, and the path drawn behind it ends at its hip."""
    tab.open(address + "?machine=runner&spring=stiffness*r&along=speed")
    run = find(runner(), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    assert shown(tab) == pytest.approx(run.alpha, rel=1e-6)
    assert f"inertia = {run.source.values['inertia']:.6g}" in element(tab, "status").text
    for place in PLACES:
        leg, *_, path = paths_in_plane(tab, place)
        assert path[:, -1] == pytest.approx(leg[:, 1], abs=1e-5)
    _, _, z, _, leg_length, _, theta, *_ = run(np.linspace(0, run.period, 400)).T
    assert max(path[1]) == pytest.approx((z + leg_length * np.cos(theta)).max(), rel=1e-3)
    type_in(tab, "number-speed", "0.5")
    faster = find(run.source, tune=("inertia", "hip_stiffness"), at={"speed": 0.5}, start=run)
    assert shown(tab) == pytest.approx(faster.alpha, rel=1e-6)
    assert "must be above 0" not in problem(tab)
    type_in(tab, "number-speed", "-1")
    shown(tab)
    assert "must be above 0" in problem(tab)


def test_the_tour_comes_once_and_when_it_is_called(tab, address):
    tab.run("localStorage.removeItem('tour')")
    tab.open(address)
    shown(tab)
    assert element(tab, "tour").is_displayed()
    assert not element(tab, "certificate").is_displayed()  # its rows are folded
    tab.driver.find_element("tag name", "body").send_keys("\ue00c")  # Escape
    assert not element(tab, "tour").is_displayed()
    tab.open(address)
    shown(tab)
    assert not element(tab, "tour").is_displayed()
    element(tab, "tour-again").send_keys("\ue007")  # Enter
    first = element(tab, "tour").text
    tab.driver.switch_to.active_element.send_keys("\ue007")
    assert element(tab, "tour").text != first
    assert "2 of 6" in element(tab, "tour").text
    for _ in range(5):
        element(tab, "tour-next").send_keys("\ue007")
    assert not element(tab, "tour").is_displayed()
    assert tab.driver.switch_to.active_element.get_attribute("id") == "tour-again"
    element(tab, "certificate-title").send_keys("\ue007")
    assert element(tab, "certificate").is_displayed()


def test_a_click_in_the_map_launches_there(page):
    page.wait("return explorer.state['map-text'].includes('%')")  # nothing more will come that moves the figure
    click(page, "map", 2.0, 1.0)
    page.wait("return explorer.state.scene.launch > 0")
    assert page.run("return explorer.state.scene.launch") == pytest.approx(2.0, abs=0.1)
    page.wait("return explorer.figures.map.renderers.some(r => r.data_source.data.alpha?.length == 1)")


def test_a_click_on_the_family_goes_there(page):
    page.wait("return explorer.state['family-text'].includes('Upward: to the end')")
    value, alpha = page.run("""
        const all = explorer.figures.family.renderers.map(r => r.data_source.data);
        const {value, quantity} = all.find(d => d.quantity?.length > 30);
        const k = value.findIndex(v => v > 1.2);
        return [value[k], quantity[k]];
    """)
    click(page, "family", value, alpha)
    page.wait("return explorer.settled && explorer.state.shown > 1")
    there = page.run("return explorer.state.dials.find(d => d.name == 'beta').value")
    assert there == pytest.approx(value, abs=0.1)
    assert shown(page) == pytest.approx(cubic(there), rel=1e-6)
    assert page.run("return explorer.state.lowest")  # a way back to the lowest hop is offered


def test_the_hops_beyond_a_fold_are_come_to_by_keyboard(tab, address):
    tab.open(address + "?spring=r%2Bbeta*r**3&p.beta=-0.008&p.rest_length=30&along=beta")
    lowest = shown(tab)
    tab.wait("return explorer.state['family-text'].includes('Downward: ')")
    slider = element(tab, "place")
    assert f"alpha = {lowest:.6g}" in slider.get_attribute("aria-valuetext")
    slider.send_keys("\ue011")  # Home, which is beyond the fold
    tab.wait("return explorer.settled && explorer.state.place.at == 0")
    slider.send_keys("\ue014" * 3)  # arrows to the right
    tab.wait("return explorer.settled && explorer.state.place.at == 3")
    alpha, told = shown(tab), tab.run("return explorer.state.dials.find(d => d.name == 'beta').value")
    machine = Hopper("r + beta*r**3", rest_length=30.0, parameters={"beta": told})
    assert alpha > 1.5 * find(machine).alpha  # at the same beta
    family = follow(machine.with_values(beta=-0.008), "beta", (0.0, -0.02), at=(told,))
    assert alpha == pytest.approx(max(point.alpha for point in family if point.value == told), rel=1e-6)
    assert tab.run("return explorer.state.lowest")  # a way back to the lowest hop is offered


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are counted by /proc")
def test_nothing_is_computed_for_a_tab_that_was_closed(browser):
    """Its workers end at once, not with its session, which here lasts longer than the test."""
    lasting = "import problems.explorer.server as server; server.SERVER = server.SERVER._replace(lifetime=3_600_000); "
    with served(before=lasting) as (address, process):
        first, before = browser.driver.current_window_handle, len(descendants(process.pid))
        browser.driver.switch_to.new_window("tab")
        try:
            browser.open(address)
            shown(browser)
            assert len(descendants(process.pid)) > before
        finally:
            browser.driver.close()
            browser.driver.switch_to.window(first)
        wait_for(lambda: len(descendants(process.pid)) <= before, "the workers of the closed tab end")


def test_a_link_shows_the_same_in_another_tab(page):
    type_in(page, "number-mass_ratio", "1.7")
    type_in(page, "spring", "r + beta*r**3 + c*r**5")
    alpha, link = shown(page), element(page, "link").get_attribute("value")
    table = page.run("return document.getElementById('certificate').textContent")
    page.wait("return location.href == arguments[0]", link)
    scene = scene_of_link(arguments(urlsplit(link).query))
    assert find(scene.build()).alpha == pytest.approx(alpha, rel=1e-6)
    first = page.driver.current_window_handle
    page.driver.switch_to.new_window("tab")
    try:
        page.resize(1200)
        page.open(link)
        shown(page)
        again = page.run("return document.getElementById('certificate').textContent")
        assert again.partition("found by")[0] == table.partition("found by")[0]
        page.open(link.partition("?")[0] + "?spring=table:/etc/passwd")
        shown(page)
        assert "cannot be followed" in problem(page)
        assert alpha_of(page) == pytest.approx(cubic(0.3), rel=1e-6)
    finally:
        page.driver.close()
        page.driver.switch_to.window(first)


def test_what_takes_long_is_stopped(page):
    before = alpha_of(page)
    page.run("explorer.ask('family', {value: 40})")
    shown(page)
    type_in(page, "spring", ENDLESS)
    page.wait("return !document.getElementById('stop').hidden")
    assert page.run("return !explorer.state.idle || explorer.state.n >= 0")
    element(page, "stop").click()
    page.wait("return document.getElementById('stop').hidden")
    shown(page)
    assert "Stopped" in problem(page)
    page.run("explorer.ask('family', {value: 1})")
    assert shown(page) == before


DROP = """
    const [name, text] = arguments, data = new DataTransfer();
    data.items.add(new File([text], name, {type: "text/csv"}));
    document.getElementById("drop").dispatchEvent(new DragEvent("drop", {dataTransfer: data, bubbles: true}));
"""


def test_rows_are_dropped(page):
    before = alpha_of(page)
    page.run(DROP, "bad.csv", "no header\n1,2\n")
    page.wait("return document.getElementById('rows-problem').textContent")
    assert alpha_of(page) == before
    page.run(
        "const s = document.getElementById('machine'); s.value = 'hopper si'; s.dispatchEvent(new Event('change'))"
    )
    shown(page)
    page.run(DROP, "leg <b>.csv", springs.SAMPLE.read_text(encoding="utf-8"))
    page.wait("return explorer.state.scene.rows")
    shown(page)
    assert element(page, "rows-name").text == "leg__b_.csv"
    element(page, "branch").send_keys("mean", "\t")
    page.wait("return explorer.settled && explorer.state.scene.rows.branch == 'mean'")
    assert problem(page, "rows-problem") == ""
    scene = scene_of_link(arguments(urlsplit(element(page, "link").get_attribute("value")).query))
    assert alpha_of(page) == pytest.approx(find(scene.build()).alpha, rel=1e-6)


def test_pictures_are_saved(page):
    for kind, begins in (("png", "\x89PNG"), ("svg", "<svg")):
        text = page.driver.execute_async_script(
            """
            const [kind, done] = arguments, old = URL.createObjectURL;
            URL.createObjectURL = (blob) => {
              blob.arrayBuffer().then((data) => done(String.fromCharCode(...new Uint8Array(data).slice(0, 4000))));
              URL.createObjectURL = old;
              return "#";
            };
            document.querySelector(`[data-save=${kind}]`).click();
            """,
            kind,
        )
        assert begins in text[:100]
