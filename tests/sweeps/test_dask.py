"""A sweep on a local Dask cluster of two workers, one of them killed on the way."""

import os
import signal
from contextlib import suppress

import pytest

from orbits import sweep
from orbits.sweeps.question import CHUNK
from problems import Hopper

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]
OVER = {"beta": (0.0, 0.5), "mass_ratio": (0.5, 2.0)}


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    options["local_directory"] = str(tmp_path_factory.mktemp("cluster"))
    running = distributed.LocalCluster(**options)
    with distributed.Client(running) as client:
        yield client
    with suppress(TimeoutError):  # on a busy machine workers end later than the cluster waits for them
        running.close()


def test_a_cluster_gives_the_same_answer_while_a_worker_is_killed(cluster):
    pids, killed = list(cluster.run(os.getpid).values()), []

    def kill_once(state):
        if not killed:
            killed.append(pids[0])
            os.kill(pids[0], signal.SIGKILL)

    found = sweep(Hopper("cubic"), OVER, 5 * CHUNK, client=cluster, progress=kill_once)
    expected = sweep(Hopper("cubic"), OVER, 5 * CHUNK)
    assert killed
    for name, column in expected.columns.items():
        assert (found.columns[name] == column).all(), name
