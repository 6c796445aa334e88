"""The server of the page: on the loopback interface alone, for its own page alone, and ended cleanly."""

import http.client
import json
import signal
import socket
import subprocess
import sys
import time
from urllib.parse import urlsplit

import pytest

from orbits import InputError, find
from problems import Hopper, explore

pytest.importorskip("bokeh")

from bokeh.client import pull_session

from problems.explorer import beginning
from problems.explorer.page import Bridge
from problems.explorer.server import serve
from tests.browser import PATIENCE, wait_for
from tests.problems.explorer.served import ENVIRONMENT, command, served

pytestmark = pytest.mark.extra("bokeh")

UPGRADE = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
UPGRADE |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": "bokeh, token"}


@pytest.fixture(scope="module")
def port():
    with served() as (address, _):
        yield urlsplit(address).port


def answer(port: int, path: str = "/", headers: dict | None = None) -> tuple[int, str]:
    """The status and the text that a request gets."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    connection.request("GET", path, headers=headers or {})
    reply = connection.getresponse()
    text = "" if reply.status == 101 else reply.read().decode()
    connection.close()
    return reply.status, text


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://localhost:{port}", 101),
        ("http://127.0.0.1:{port}", 101),
        ("http://localhost", 403),
        ("http://localhost:1", 403),
        ("http://localhost.evil.example:{port}", 403),
        ("http://evil.example:{port}", 403),
        ("http://0.0.0.0:{port}", 403),
        ("https://evil.example", 403),
        ("null", 403),
        ("", 403),
    ],
)
def test_only_its_own_page_may_talk_to_it(port, origin, status):
    headers = UPGRADE | {"Origin": origin.format(port=port)}
    assert answer(port, "/ws", headers)[0] == status
    if status == 403:
        for path in ("/", "/metadata", "/static/js/bokeh.min.js"):
            assert answer(port, path, {"Origin": headers["Origin"]})[0] == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site", "same-origin", "none"])
@pytest.mark.parametrize("use", ["document", "iframe", "script", "image", "empty"])
def test_other_sites_lead_to_the_page_and_load_nothing_of_it(port, site, use):
    """A browser states no origin for `<script src>` and for `<img>`, but what it fetches them for."""
    status = 200 if site in ("same-origin", "none") or use in ("document", "iframe") else 403
    for path in ("/metadata", "/static/js/bokeh.min.js", *(["/"] if status == 403 else [])):
        assert answer(port, path, {"Sec-Fetch-Site": site, "Sec-Fetch-Dest": use})[0] == status


def test_no_other_site_may_read_what_it_serves(port):
    assert answer(port, "/static/js/bokeh.min.js", {"Origin": f"http://localhost:{port}"})[0] == 200
    for path in ("/autoload.js", "/autoload.js?bokeh-autoload-element=1"):
        assert answer(port, path)[0] == 404


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example", "0.0.0.0", "127x0x0x1", "[::1]"])
@pytest.mark.parametrize("path", ["/", "/ws", "/metadata", "/static/js/bokeh.min.js"])
def test_a_name_that_another_site_gives_this_machine_is_refused(port, host, path):
    headers = {"Host": f"{host}:{port}", "Origin": f"http://localhost:{port}"}
    assert answer(port, path, headers | (UPGRADE if path == "/ws" else {}))[0] == 404


@pytest.mark.parametrize("path", ["/static/js/%00", "/%00", "/static/%00/js"])
def test_what_no_file_can_be_called_is_not_found(port, path):
    assert answer(port, path)[0] == 404


@pytest.mark.slow
def test_the_page_is_served_by_both_names_of_this_machine(port):
    for host in ("localhost", "127.0.0.1"):
        assert "startExplorer" in answer(port, headers={"Host": f"{host}:{port}"})[1]


@pytest.mark.slow
def test_a_page_names_no_address_but_its_own(port):
    status, text = answer(port)
    assert status == 200
    assert "Lossless hops" in text
    words = text.replace(f"http://localhost:{port}", "")
    assert "https://" not in words
    assert 'src="http' not in words


def test_only_the_loopback_interface_is_listened_on(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        try:
            other.connect(("192.0.2.1", 9))  # sends nothing, but tells the address of the way out
        except OSError:
            pytest.skip("this machine has no other interface")
        address = other.getsockname()[0]
    if address.startswith("127."):
        pytest.skip("this machine has no other interface")
    with pytest.raises(OSError, match=r"refused|timed out"):
        socket.create_connection((address, port), timeout=2)


class Tab:
    """A tab without a browser: what its fields ask, and what they are told."""

    def __init__(self, port: int, **query: str):
        self._address = f"http://localhost:{port}/"
        self.session = pull_session(url=self._address, arguments=query)
        self._asked = 0

    def ask(self, act: str, **rest) -> None:
        self._asked += 1
        bridge_of(self.session).request = json.dumps({"n": self._asked, "act": act, **rest})
        self.session.force_roundtrip()

    def told(self) -> dict:
        """All that the fields show, as soon as it is what was asked for."""

        def settled() -> dict | None:
            with pull_session(self.session.id, self._address) as now:  # a client hears nothing by itself
                told = json.loads(bridge_of(now).page_state)
            return told if told["idle"] and told["n"] == self._asked else None

        return wait_for(settled, "the hop that was asked for is shown")


def alpha_of(told: dict) -> float:
    """The launch speed that a tab is told, to six digits."""
    return float(told["title"].partition("α = ")[2].split()[0])


def bridge_of(session) -> Bridge:
    return next(model for model in session.document.models if isinstance(model, Bridge))


def cubic(beta: float) -> float:
    return find(Hopper("r + beta*r**3", rest_length=8.0, parameters={"beta": beta})).alpha


@pytest.mark.slow
def test_tabs_do_not_disturb_each_other(port):
    betas = [0.1, 0.55]
    tabs = [Tab(port, **{"spring": "r + beta*r**3", "p.beta": str(beta), "p.rest_length": "8"}) for beta in betas]
    tabs[0].ask("spring", value="r + ")  # what goes wrong in one is not told in another
    tabs[1].ask("number", name="beta", value=betas[1] + 0.05)
    for k, (tab, beta) in enumerate(zip(tabs, betas, strict=True)):
        told = tab.told()
        assert set(told["problems"]) == ({"spring"} if k == 0 else set())
        assert alpha_of(told) == pytest.approx(cubic(beta + 0.05 * (k == 1)), rel=5e-6)
    for tab in tabs:
        tab.session.close()


@pytest.mark.slow
def test_an_interrupt_ends_it_cleanly():
    with served() as (address, process):
        answer(urlsplit(address).port)  # a tab, which has workers
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0
        assert err == ""
        assert "Traceback" not in out


@pytest.mark.slow
def test_a_port_that_is_taken_is_said(port):
    run = subprocess.run(
        command("--port", str(port)), capture_output=True, text=True, env=ENVIRONMENT, timeout=PATIENCE
    )
    assert run.returncode == 2
    assert f"port {port} is taken" in run.stderr


def test_bad_options_are_said_before_anything_is_served(orbits):
    run = orbits("explore --no-browser --spring 'r + c*r**3'")
    assert run.code == 2
    assert "without a value" in run.err
    assert orbits("explore --port 70000").code == 2


def test_without_bokeh_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "bokeh.server.server", None)
    with pytest.raises(InputError, match=r"persistent-orbits\[explore\]"):
        serve(beginning("hopper"))
    with pytest.raises(InputError, match=r"persistent-orbits\[explore\]"):
        explore(Hopper())


@pytest.mark.slow
def test_a_notebook_shows_the_page_of_a_machine():
    page = explore(Hopper("tanh", rest_length=20.0, parameters={"b": 0.1}), height=700)
    try:
        text = page._repr_html_()
        assert text.startswith("<iframe")
        assert page.address in text
        assert "height:700px" in text
        assert "tanh" not in repr(page)
        assert answer(urlsplit(page.address).port)[0] == 200
    finally:
        page.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", urlsplit(page.address).port), timeout=2)


@pytest.mark.slow
def test_what_is_no_machine_is_said():
    with pytest.raises(InputError, match="is not a machine"):
        explore("hopper")


@pytest.mark.slow
def test_a_script_without_a_guard_is_told_so(tmp_path):
    """Workers import the script that started them, which would serve another page each; here they end with an error."""
    script = tmp_path / "show.py"
    script.write_text(
        "import time\n"
        "from multiprocessing import active_children\n"
        "from urllib.request import urlopen\n"
        "from problems import explore\n"
        "page = explore()\n"
        "urlopen(page.address).read()\n"
        "while active_children():\n"
        "    time.sleep(0.05)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=ENVIRONMENT, timeout=PATIENCE)
    assert "call explore under  if __name__ == '__main__':" in done.stderr
