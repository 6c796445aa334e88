"""The page served on the loopback interface alone, for as long as the program runs or the notebook is open."""

import errno
import logging
import re
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from orbits.errors import InputError

from .processes import prepare

if TYPE_CHECKING:
    from bokeh.server.server import BaseServer
    from tornado.routing import Matcher

    from .scene import Scene

LOOPBACK = "127.0.0.1"
HOSTS = (LOOPBACK, "localhost")  # the names under which a browser requests the page


class ServerOptions(NamedTuple):
    """What the server of a page keeps and receives."""

    message: int = 8 << 20  # bytes of one from a page: measured rows as JSON, in which a letter may take six characters
    tabs: int = 40  # each has figures of its own, which the server keeps
    lifetime: int = 5000  # milliseconds after which the session of a closed tab ends


SERVER = ServerOptions()
SHOWN_ELSEWHERE = ("document", "iframe")  # what a page of another site may make of this one: it reads neither


def serve(scene: "Scene", port: int = 0, python_machine: object = None) -> "tuple[BaseServer, str]":
    """A server of the page, not started yet, and its address.

    scene : the scene that the page shows first
    port : of the loopback interface; 0 for any that is free
    python_machine : the machine, where no statement makes it

    Raises `InputError` without the extra `explore`, and where the port is taken.
    """
    import asyncio

    try:
        from bokeh.application.application import Application
        from bokeh.application.handlers.function import FunctionHandler
        from bokeh.server.server import BaseServer
        from bokeh.server.tornado import BokehTornado
        from bokeh.settings import settings
        from tornado.httpserver import HTTPServer
        from tornado.ioloop import IOLoop
        from tornado.routing import HostMatches, PathMatches, Rule, RuleRouter
        from tornado.web import Application as Pages, ErrorHandler
    except ImportError:
        raise InputError("the page needs Bokeh: install persistent-orbits[explore]") from None
    prepare()
    sockets = _bound(port)
    port = sockets[0].getsockname()[1]
    hosts = [f"{name}:{port}" for name in HOSTS]
    asyncio.set_event_loop(asyncio.new_event_loop())  # of this thread, which tornado then takes
    loop = IOLoop.current()
    for name in ("bokeh", "tornado"):
        logging.getLogger(name).setLevel(logging.ERROR)
    settings.allowed_ws_origin = []  # no other origin is admitted, whatever the environment sets
    application = Application(FunctionHandler(_page_of(scene, python_machine)))
    tornado = BokehTornado(
        {"/": application},
        extra_websocket_origins=hosts,
        websocket_max_message_size_bytes=SERVER.message,
        check_unused_sessions_milliseconds=2000,
        unused_session_lifetime_milliseconds=SERVER.lifetime,
    )
    # A host name that another site points to this computer is refused for every path, as are another site's scripts.
    refused = {code: Pages([(".*", ErrorHandler, {"status_code": code})]) for code in (403, 404)}
    # What no file can be called, and what any site may load.
    others = Rule(_of_other_sites(hosts), refused[403]), Rule(PathMatches(r".*(%00.*|/autoload\.js)"), refused[404])
    own = RuleRouter([*others, *(Rule(HostMatches(re.escape(name)), tornado) for name in HOSTS)])
    http = HTTPServer(own, max_header_size=1 << 16)
    http.add_sockets(sockets)
    return BaseServer(loop, tornado, http), f"http://localhost:{port}/"


def _of_other_sites(hosts: list[str]) -> "Matcher":
    """The requests that a page of another site makes, by the origin that the browser states or, as for `<script src>`
    it states none, by the site and by what the reply would become there; a link and a notebook's frame lead here."""
    from tornado.routing import Matcher

    class OtherOrigins(Matcher):
        def match(self, request: Any) -> dict[str, Any] | None:
            origin, *fetched = map(request.headers.get, ("Origin", "Sec-Fetch-Site", "Sec-Fetch-Dest"))
            foreign = fetched[0] in ("cross-site", "same-site") and fetched[1] not in SHOWN_ELSEWHERE
            return {} if foreign or (origin is not None and origin.removeprefix("http://") not in hosts) else None

    return OtherOrigins()


def _bound(port: int) -> list[socket.socket]:
    """The sockets of a port of the loopback interface."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((LOOPBACK, port))
        listening.listen(128)
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(f"port {port} is taken, maybe by another page: give another one, or 0 for any") from None
        raise InputError(f"port {port} cannot be served: {error.strerror}; give one from 1024 to 65535") from None
    listening.setblocking(False)
    return [listening]


def _page_of(scene: "Scene", python_machine: object) -> Callable[[Any], None]:
    """The function that fills the document of a tab."""
    from .worker import pools_of

    tabs, pools = set[str](), pools_of(python_machine)

    def fill(document: Any) -> None:
        from .forms import scene_of_link
        from .page import Explorer

        request = document.session_context.request
        if len(tabs) >= SERVER.tabs:
            document.add_root(_page_of_text(f"{SERVER.tabs} tabs are open, and no more are served: close some."))
            return
        try:
            begun, problem = (scene_of_link(request.arguments) if request.arguments else scene), ""
        except InputError as error:
            begun, problem = scene, f"The link cannot be followed: {error}"
        tabs.add(document.session_context.id)
        document.on_session_destroyed(lambda context: tabs.discard(context.id))
        Explorer(document, begun, pools, python_machine, problem)

    return fill


def _page_of_text(text: str) -> object:
    """A text as a model of Bokeh."""
    from orbits.show import bokeh

    return bokeh("models").Div(text=escape(text))


def run(scene: "Scene", port: int, browser: bool, report: Callable[[str], None]) -> None:
    """Serve the page until the program is interrupted, and open it in a browser if `browser` is true."""
    server, address = serve(scene, port)
    server.start()
    report(f"{address} shows the page; Ctrl-C ends it")
    if browser:
        import webbrowser

        server.io_loop.add_callback(webbrowser.open, address)
    try:
        server.io_loop.start()
    except KeyboardInterrupt:
        pass
    finally:
        server.unlisten()
        server.stop()


async def _finish_tasks() -> None:
    """Wait for the remaining tasks of a stopped server in the loop of this thread, some seconds at most."""
    import asyncio

    if tasks := asyncio.all_tasks() - {asyncio.current_task()}:
        await asyncio.wait(tasks, timeout=5)


def _run_server(started: "Future[tuple[BaseServer, str]]", scene: "Scene", python_machine: object) -> None:
    """Serve the page in this thread until the server is stopped; `started` receives the server and its address, or why
    there is none."""
    try:
        server, address = serve(scene, 0, python_machine)
        server.start()
    except BaseException as error:
        started.set_exception(error)
        return
    started.set_result((server, address))
    loop = server.io_loop
    loop.start()
    loop.run_sync(_finish_tasks)
    loop.close()


class Exploration:
    """A page that is served in the background; a notebook shows it, and `close` ends it.

    address : of the page
    """

    def __init__(self, machine: Any, height: int):
        from .scene import scene_of_machine, with_surroundings

        scene = with_surroundings(scene_of_machine(machine))
        python_machine = machine if scene.fixed_laws else None
        started: Future[tuple[BaseServer, str]] = Future()
        self._thread = threading.Thread(target=_run_server, args=(started, scene, python_machine), daemon=True)
        self._thread.start()
        self._server, self.address = started.result()
        self.height = height

    def close(self) -> None:
        """End the page and its processes."""

        def end() -> None:
            self._server.unlisten()
            self._server.stop()
            self._server.io_loop.stop()

        self._server.io_loop.add_callback(end)
        self._thread.join()

    def __repr__(self) -> str:
        return f"Exploration({self.address!r})"

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{self.height}px;border:1px solid #ccc"
        return f'<iframe src="{escape(self.address)}" title="Lossless hops" style="{style}"></iframe>'


def explore(machine: Any = None, *, height: int = 900) -> Exploration:
    """Show a machine's lossless hop on a page with sliders, in a notebook.

    machine : as in `orbits.find`; by default a hopper with a cubic spring. Formulas of its statement can be changed on
        the page; for a machine without formulas, its parameters
    height : of the page in the notebook, in pixels

    The page is that of the command `orbits explore`, served on the loopback interface until Python ends or `close` of
    the result is called; any browser on this computer can open its `address`. The kernel has to run on this computer
    too. In a script, call it below `if __name__ == "__main__":`. Raises `InputError` without the extra `explore`, and
    for arguments that are not machines.
    """
    if machine is None:
        from ..machines import Hopper

        machine = Hopper("r + beta*r**3", rest_length=8.0, parameters={"beta": 0.3})
    from multiprocessing import current_process

    from orbits.model import check_machine

    check_machine(machine, "with_values")
    if getattr(current_process(), "_inheriting", False):  # a worker is importing the script that called this
        raise InputError("in a script, call explore under  if __name__ == '__main__':")
    return Exploration(machine, height)
