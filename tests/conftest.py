"""Settings that all tests share."""

import contextlib
import csv
import gc
import os
import signal
import sys

# A test has one core: threads of torch and of BLAS that wait for each other would take the others' as well. Set before
# either is loaded, and passed on to what the tests start.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# What the tests start imports the package a hundred times: it is compiled to bytecode once, wherever they run.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import pytest
from hypothesis import settings

sys.dont_write_bytecode = False

# Where the tests run in the background Ctrl-C is ignored, and what they start and interrupt would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The first example of a property may compile the kernel that it tests; no example is judged by the clock. Every plain
# run draws the same examples and keeps none; `pytest --hypothesis-profile=thorough` draws many others each time. A
# costly law draws a share of `settings().max_examples`.
settings.register_profile("fixed", deadline=None, derandomize=True, database=None, max_examples=60)
settings.register_profile("thorough", deadline=None, max_examples=1000, print_blob=True)
settings.load_profile("fixed")


def pytest_collection_finish() -> None:
    """Lets no collection of garbage look at all that was imported again: that took an eighth of the tests' time."""
    gc.collect()
    gc.freeze()


def _draw_nothing(patch: pytest.MonkeyPatch) -> None:
    # in their place what leaves nothing, and travels to other processes
    patch.setattr("wayfield.benchmarks.figures.document_figures.draw", len)
    patch.setattr("wayfield.benchmarks.figures.contest_figures.draw_contest", len)


@pytest.fixture
def undrawn(monkeypatch):
    """For runs of which no figure is looked at: to draw them takes as long as all the rest."""
    _draw_nothing(monkeypatch)


@pytest.fixture(scope="module")
def undrawn_module():
    """Likewise for all runs of a module, those of its fixtures included."""
    with pytest.MonkeyPatch.context() as patch:
        _draw_nothing(patch)
        yield


@pytest.fixture(autouse=True)
def _fields_of_usual_size():
    """Undoes what a command that reads long fields does to the whole process."""
    limit = csv.field_size_limit()
    yield
    csv.field_size_limit(limit)


@pytest.fixture
def serve():
    """Returns what serves a scene on a free port, in a thread, until the test's end."""
    pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')
    pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
    from wayfield.bridges.coppelia.scenes import Conditions, make_world
    from wayfield.bridges.coppelia.server import Server

    with contextlib.ExitStack() as stack:

        def started(scene="empty", speed=0.0, load=None, **conditions):
            world = make_world(scene, Conditions(**conditions))
            return stack.enter_context(Server(world, port=0, speed=speed, load=load))

        yield started


@pytest.fixture
def connect():
    """Returns what connects the real client to a server and gives its `sim`; no answer in ten seconds is an error."""
    remote = pytest.importorskip("coppeliasim_zmqremoteapi_client", reason='needs pip install "wayfield[coppelia]"')

    def connected(server):
        client = remote.RemoteAPIClient(port=server.port)
        client.socket.RCVTIMEO = 10_000
        client.socket.LINGER = 0
        sim = client.require("sim")
        sim.client = client
        return sim

    return connected


@pytest.fixture
def desk():
    """Returns what makes a server that nobody serves, whose functions are called at once."""
    from oracles.desk import Desk

    with contextlib.ExitStack() as stack:

        def made(*args, **kwargs):
            one = Desk(*args, **kwargs)
            stack.callback(one.server.close)
            return one

        yield made
