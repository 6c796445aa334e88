"""How the processes of workers are started: by a server that has imported the solver, where there is one."""

from typing import Any

from orbits.running import interrupts

# What the server of processes imports before the first one is asked of it.
PRELOADED = ["problems.explorer.worker"]


def process_context() -> Any:
    """What makes processes: from a server of their own, and by new interpreters where there is none."""
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
