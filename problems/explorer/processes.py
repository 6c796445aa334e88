"""How the processes of workers are started: where possible by a server that has imported the solver."""

from typing import Any

from orbits.running import interrupts

# The modules that the server of processes imports before it starts the first process.
PRELOADED = ["problems.explorer.worker"]


def process_context() -> Any:
    """The context that starts processes: from a server of processes, else by new interpreters."""
    from multiprocessing import get_all_start_methods, get_context

    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


def prepare() -> None:
    """Start the server of processes in the background, so that the first worker need not wait for its imports."""
    from multiprocessing import forkserver

    if process_context().get_start_method() == "forkserver":
        with interrupts.not_for_children():
            forkserver.ensure_running()
