"""Settings that all tests share."""

import atexit
import contextlib
import csv
import gc
import importlib
import os
import signal
import sys
from pathlib import Path

# A test has one core: threads of torch and of BLAS that wait for each other would take the others' as well. Set before
# either is loaded, and passed on to what the tests start.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# What is imported is kept as bytecode, as kernels are beside it, whatever the environment says: the tests start some
# hundred interpreters.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Where the tests run in the background Ctrl-C is ignored, and what they start and interrupt would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The first example of a property may compile the kernel that it tests; no example is judged by the clock. Every plain
# run draws the same examples and keeps none; `pytest --hypothesis-profile=thorough` draws many others each time. A
# costly law draws a share of `settings().max_examples`.
settings.register_profile("fixed", deadline=None, derandomize=True, database=None, max_examples=100)
settings.register_profile("thorough", deadline=None, max_examples=1000, print_blob=True)
settings.load_profile("fixed")

# until all tests are known nothing is waste: to look for it would take a tenth of that time
gc.disable()


# What nearly every test needs: the step of a task, and the pymunk plant. They take some ten seconds each to compile.
NEEDED = (("wayfield/DiffDrivePathFollowing-v0", "pymunk"), ("wayfield/OmniGoalObstacles-v0", "kinematic"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """Shares out among several workers what each of them would else do, or wait for, before its first test.

    That is the bytecode of the tests, of which each makes another part first and finds the others' afterwards, and the
    kernels that all need.
    """
    told = getattr(session.config, "workerinput", None)
    if told is None or session.config.args != session.config.getini("testpaths"):
        return
    worker = int(told["workerid"].removeprefix("gw"))
    files = sorted(Path(__file__).parent.glob("test_*.py"))
    for file in files[len(files) * worker // told["workercount"] :]:
        with contextlib.suppress(Exception, pytest.skip.Exception):  # told when it is collected
            importlib.import_module(file.stem)
    for name, dynamics in NEEDED[worker : worker + 1]:
        with contextlib.suppress(Exception):  # told by the tests
            import gymnasium

            env = gymnasium.make(f"wayfield:{name}", dynamics=dynamics)
            env.reset(seed=0)
            env.step(env.action_space.sample())


@pytest.hookimpl(trylast=True)
def pytest_collection_finish(session):
    """Spares the collector of waste what is loaded by now, and stays: looking through it takes 3 % of the tests.

    And has it look more seldom, which takes another 4 %: hypothesis keeps account of each time.
    """
    gc.freeze()
    gc.set_threshold(20_000)
    gc.enable()


def _end(worker):
    """Ends a worker, but none of the processes that it has forked."""
    if os.getpid() == worker:
        os._exit(0)


# What a worker has compiled and loaded is freed with its memory: one by one that takes seconds. The first to be asked
# for is the last that is done.
if "PYTEST_XDIST_WORKER" in os.environ:
    atexit.register(_end, os.getpid())


@pytest.fixture
def undrawn(monkeypatch):
    """For runs of which no figure is looked at: to draw them takes as long as all the rest."""
    for name in ("document_figures.draw", "contest_figures.draw_contest"):
        monkeypatch.setattr(f"wayfield.benchmarks.{name}", len)  # which leaves nothing, and travels to other processes


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
    from wayfield.envs.coppelia.scenes import Conditions, make_world
    from wayfield.envs.coppelia.server import Server

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
    from test_restated_coppelia import Desk

    with contextlib.ExitStack() as stack:

        def made(*args, **kwargs):
            one = Desk(*args, **kwargs)
            stack.callback(one.server.close)
            return one

        yield made
