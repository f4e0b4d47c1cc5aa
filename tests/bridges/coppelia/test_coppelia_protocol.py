"""CoppeliaSim's remote API: messages, clients and stepping, with the real client where there is one to use."""

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

cbor2 = pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
zmq = pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("coppeliasim_zmqremoteapi_client", reason='needs pip install "wayfield[coppelia]"')

from wayfield.bridges.coppelia import codec  # noqa: E402
from wayfield.bridges.coppelia.calls import NOT_OFFERED  # noqa: E402
from wayfield.bridges.coppelia.scenes import Conditions, make_world  # noqa: E402
from wayfield.bridges.coppelia.server import Server  # noqa: E402
from wayfield.bridges.coppelia.signatures import FUNCTIONS  # noqa: E402

ROBOT, RIGHT, LEFT = "/PioneerP3DX", "/PioneerP3DX/rightMotor", "/PioneerP3DX/leftMotor"


class Raw:
    """A socket that sends bytes and must get an answer within a second."""

    def __init__(self, server, kind=zmq.REQ):
        self.port = server.port
        self.context = zmq.Context()
        self.kind = kind
        self.open()

    def open(self):
        self.socket = self.context.socket(self.kind)
        self.socket.LINGER = 0
        self.socket.connect(f"tcp://127.0.0.1:{self.port}")

    def ask(self, payload, within=1.0):
        self.socket.send(payload)
        assert self.socket.poll(1000 * within), f"no answer to {payload[:80]!r}"
        return cbor2.loads(self.socket.recv())

    def call(self, func, *args, uuid="raw"):
        return self.ask(cbor2.dumps({"uuid": uuid, "func": func, "args": list(args)}))

    def close(self):
        self.context.destroy(linger=0)


@pytest.fixture(scope="module")
def busy():
    """A server that many examples share."""
    with Server(make_world("document-a"), port=0, speed=0.0) as server:
        yield server


@pytest.fixture(scope="module")
def raw(busy):
    socket = Raw(busy)
    yield socket
    socket.close()


# Messages.


@given(st.binary(max_size=200))
def test_any_bytes_get_an_answer(raw, payload):
    reply = raw.ask(payload)
    assert set(reply) in ({"err"}, {"ret"}, {"success", "error"})


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=9)
    | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=9) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=20,
)
HOLDING = ("sim.setStepping", "sim.acquireLock", "sim.wait", "sim.step", "sim.yield", "sim.switchThread")
NAMES = sorted({*FUNCTIONS, *NOT_OFFERED} - {*HOLDING, "sim.startSimulation"})


def answers(raw, func, args):
    reply = raw.ask(cbor2.dumps({"uuid": "raw", "func": func, "args": args}))
    assert set(reply) in ({"err"}, {"ret"}, {"func", "args"}), reply
    assert "internal error" not in reply.get("err", "")


HANDLES = st.integers(-15, 60) | st.floats(0, 60).map(round).map(float)
PLAUSIBLE = st.one_of(
    HANDLES,
    st.lists(st.floats(-3, 3), max_size=30),
    st.lists(st.floats(-3, 3), min_size=7, max_size=7).map(lambda row: row * 4),
    st.sampled_from(["/PioneerP3DX", "/Path", "/*", "customData.PATH", "signal.a", "quadraticBezier", "cb@func"]),
    st.dictionaries(st.sampled_from(["index", "noError", "type", "strength"]), HANDLES, max_size=2),
    VALUES,
)


@given(st.sampled_from(NAMES), st.lists(PLAUSIBLE, max_size=7))
@settings(max_examples=100)
def test_plausible_arguments_get_an_answer_and_no_function_fails(raw, func, args):
    answers(raw, func, args)


@given(VALUES)
def test_the_scan_agrees_with_the_decoder(value):
    payload = cbor2.dumps({"uuid": "u", "func": "f", "args": [value]})
    if "nan" in repr(value) or "inf" in repr(value):
        with contextlib.suppress(codec.Refusal):  # unless the letters stand in a text
            codec.request_of(payload)
        return
    assert repr(codec.request_of(payload).args) == repr(cbor2.loads(payload)["args"])


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "ends before"),
        (b"\xff\x00junk", "indefinite"),
        (cbor2.dumps({"uuid": "u"}) + b"\0", "after its end"),
        (b"\x81" * 5000 + b"\0", "nested deeper"),
        (b"\x9a\x03\x00\x00\x00" + b"\0" * 0x3000000, "items"),
        (b"\xc1\x00", "tag"),
        (cbor2.dumps({1: 2}), "no text"),
        (cbor2.dumps([1]), "no map"),
        (cbor2.dumps({"uuid": 5, "func": "x"}), "uuid"),
        (cbor2.dumps({"uuid": "u", "func": 5}), "func"),
        (cbor2.dumps({"uuid": "u", "func": "x", "args": 5}), "args"),
        (cbor2.dumps({"uuid": "u", "eval": "1+1"}), "evaluated"),
        (cbor2.dumps({"uuid": "u", "func": "sim.wait", "args": [1, float("nan")]}), "argument 2"),
        (cbor2.dumps({"uuid": "u", "func": "sim._step"}), "No such function"),
        (cbor2.dumps({"uuid": "u", "func": "sim.loadScene", "args": ["/etc/passwd"]}), "sim.loadScene"),
    ],
)
def test_what_is_no_request_is_refused_in_one_line(raw, payload, words):
    error = raw.ask(payload)["err"]
    assert words in error
    assert "\n" not in error


def test_a_message_over_the_limit_ends_its_connection_alone(serve, connect, monkeypatch):
    monkeypatch.setattr("wayfield.bridges.coppelia.server.MAX_MESSAGE", 100_000)
    server = serve()
    sim = connect(server)
    raw = Raw(server)
    raw.socket.send(bytes(200_000))
    assert not raw.socket.poll(200)
    assert sim.getSimulationTime() == 0.0
    raw.close()


def test_info_is_flat_and_lists_what_is_not_offered(serve, connect):
    sim = connect(serve())
    listed = sim.client.call("zmqRemoteApi.info", ["sim"])
    assert all(list(each) in (["func"], ["const"]) for each in listed.values())
    assert sim.handle_world == -1
    assert sim.simulation_advancing_running == 17
    with pytest.raises(Exception, match=r"in sim\.getVisionSensorImg: not offered by wayfield's server: .*cameras"):
        sim.getVisionSensorImg(1)
    with pytest.raises(Exception, match="module 'simIK' not found"):
        sim.client.require("simIK")
    with pytest.raises(Exception, match=r"No such function: sim\.x"):
        sim.client.call("sim.x", [])


def test_no_result_is_none_one_is_itself_several_are_a_tuple_and_an_error_is_an_exception(serve, connect):
    sim = connect(serve())
    assert sim.addLog(sim.verbosity_scriptinfos, "hello") is None
    assert isinstance(sim.getObjectPosition(sim.getObject(ROBOT)), list)
    assert isinstance(sim.readProximitySensor(sim.getObject("/ultrasonicSensor[0]")), tuple)
    for call, words in (
        (lambda: sim.getObjectPosition(), "the function requires more arguments"),
        (lambda: sim.getJointPosition(sim.getObject(ROBOT)), "object is not a joint"),
        (lambda: sim.readProximitySensor(sim.getObject(ROBOT)), "object is not a proximity sensor"),
        (lambda: sim.setObjectPosition(sim.getObject(ROBOT), [1.0]), "incorrect table size"),
    ):
        with pytest.raises(Exception, match=words) as error:
            call()
        assert type(error.value) is Exception
    assert sim.getObject(ROBOT) > 0


def test_values_come_back_as_they_were(serve, connect):
    sim = connect(serve())
    for value in (bytes(range(256)) * 4096, [0.5] * 100_000, "çà", [True, -1, 2**40, {"a": [1, {"b": None}]}]):
        sim.setStringSignal("x", value)
        assert sim.getStringSignal("x") == value
    sim.clearStringSignal("x")
    assert sim.getStringSignal("x") is None
    sim.setInt32Signal("i", 3)
    sim.setFloatSignal("f", 0.5)
    sim.setBufferSignal("b", b"\0\xff")
    assert (sim.getIntegerSignal("i"), sim.getFloatSignal("f"), sim.getBufferSignal("b")) == (3, 0.5, b"\0\xff")


def test_too_much_data_is_refused_and_changes_nothing(serve, connect, monkeypatch):
    monkeypatch.setattr("wayfield.bridges.coppelia.calls_data.MAX_STORED", 1000)
    sim = connect(serve())
    sim.setStringSignal("x", b"a" * 900)
    with pytest.raises(Exception, match="no more data"):
        sim.setStringSignal("y", b"a" * 200)
    assert sim.getStringSignal("x") == b"a" * 900
    assert sim.getStringSignal("y") is None
    sim.clearStringSignal("x")
    sim.setStringSignal("y", b"a" * 200)


def test_callbacks_run_in_the_client_and_may_call_back(serve, connect):
    sim = connect(serve())

    class Holder:
        def method(self, a, b):
            return a + b + sim.getSimulationTime()

    assert sim.testCB(20, Holder().method, 22) == 42.0

    def raises(a, b):
        raise ValueError("in the callback")

    with pytest.raises(ValueError, match="in the callback"):
        sim.testCB(1, raises, 2)
    assert sim.testCB(1, lambda a, b: a - b, 2) == -1


def test_bytes_that_are_no_zeromq_end_their_connection_alone(serve, connect):
    server = serve()
    sim = connect(server)
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as stranger:
        stranger.sendall(b"GET / HTTP/1.1\r\n\r\n" + bytes(200))
        with contextlib.suppress(ConnectionResetError):
            while stranger.recv(1000):  # libzmq greets first
                pass
    assert sim.getSimulationTime() == 0.0


def test_a_peer_that_never_reads_does_not_keep_others_waiting(serve, connect):
    server = serve("document-a")
    sim = connect(server)
    deaf = Raw(server, zmq.DEALER)
    deaf.socket.RCVHWM = 1
    deaf.open()
    payload = cbor2.dumps({"uuid": "deaf", "func": "zmqRemoteApi.info", "args": ["sim"]})
    for _ in range(1000):
        with contextlib.suppress(zmq.Again):
            deaf.socket.send_multipart([b"", payload], zmq.NOBLOCK)
    began = time.monotonic()
    for _ in range(20):
        sim.getSimulationTime()
    assert time.monotonic() - began < 60.0
    deaf.close()


def test_the_oldest_silent_client_makes_room_for_a_new_one(serve, connect, monkeypatch):
    monkeypatch.setattr("wayfield.bridges.coppelia.server.MAX_CLIENTS", 4)
    server = serve()
    keeper = connect(server)
    keeper.setStepping(True)
    others = [connect(server) for _ in range(8)]
    assert keeper.setStepping(True) == 1  # whoever steps stays
    assert [sim.getSimulationTime() for sim in others] == [0.0] * 8  # whoever went is a new client when he comes back


def test_the_asyncio_client_calls_at_once_and_each_reply_belongs_to_its_call(serve):
    from coppeliasim_zmqremoteapi_client.asyncio import RemoteAPIClient

    async def visit(port):
        async with RemoteAPIClient(port=port) as client:
            sim = await client.require("sim")
            dummies = await asyncio.gather(*[sim.createDummy(0.01) for _ in range(20)])
            await asyncio.gather(*[sim.setObjectPosition(each, [0.1 * i, 0, 0]) for i, each in enumerate(dummies)])
            places = await asyncio.gather(*[sim.getObjectPosition(each) for each in dummies])
            assert [x for x, _, _ in places] == pytest.approx([0.1 * i for i in range(20)])
            await sim.setStepping(True)
            await sim.startSimulation()
            _, state = await asyncio.gather(sim.step(), sim.getSimulationState())
            assert state in (16, 17)
            assert await sim.getSimulationTime() == 0.05
            rows = await sim.readCustomDataBlock(await sim.getObject("/Path"), "PATH")
            assert len(await sim.unpackDoubleTable(rows)) == 700

    asyncio.run(visit(serve("document-a").port))


# Stepping.


def test_stepping_is_counted(serve, connect):
    sim = connect(serve())
    assert [sim.setStepping(True), sim.setStepping(True), sim.setStepping(False), sim.setStepping(False)] == [
        0,
        1,
        2,
        1,
    ]
    assert [sim.setStepping(False), sim.setStepping(False)] == [0, 0]


def test_time_stands_between_steps_and_is_accumulated(serve, connect):
    sim = connect(serve(speed=1.0))
    sim.setStepping(True)
    sim.startSimulation()
    assert (sim.getSimulationTime(), sim.getSimulationState()) == (0.0, 16)
    sim.step()
    assert (sim.getSimulationTime(), sim.getSimulationState()) == (0.05, 17)
    steps = 1
    while sim.getSimulationTime() < 3:
        sim.step()
        steps += 1
    assert steps == 61  # 0.05 sixty times is a little less than 3


def test_free_running_keeps_the_wall_clock(serve, connect):
    sim = connect(serve(speed=20.0))
    sim.startSimulation()
    began, first = time.monotonic(), sim.getSimulationTime()
    # on a busy machine it may fall behind, which it does not make up for
    while (passed := sim.getSimulationTime() - first) < 2.0:
        assert time.monotonic() - began < 60.0
    assert passed <= 20.0 * (time.monotonic() - began) + 0.101  # a period each at begin and end
    before = sim.getSimulationTime()
    sim.step()
    assert sim.getSimulationTime() > before


def test_two_stepping_clients_wait_for_each_other(serve, connect):
    server = serve()
    first, second = connect(server), connect(server)
    first.setStepping(True)
    second.setStepping(True)
    first.startSimulation()
    stepped = threading.Event()
    thread = threading.Thread(target=lambda: (second.step(), stepped.set()))
    thread.start()
    assert not stepped.wait(0.1)
    assert first.getSimulationTime() == 0.0
    first.step()
    thread.join(60)
    assert stepped.is_set()
    assert first.getSimulationTime() == 0.05


def test_a_killed_client_lets_the_simulation_go_on(serve, connect):
    server = serve()
    sim = connect(server)
    script = f"""
        import time
        from coppeliasim_zmqremoteapi_client import RemoteAPIClient
        sim = RemoteAPIClient(port={server.port}).require("sim")
        sim.setStepping(True)
        sim.acquireLock()
        print("held", flush=True)
        time.sleep(60)
    """
    child = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b"held\n"
    sim.startSimulation()
    assert sim.getSimulationTime() == 0.0
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    child.stdout.close()
    began = time.monotonic()
    while sim.getSimulationTime() == 0.0:
        assert time.monotonic() - began < 60.0


def test_ctrl_c_in_the_middle_of_a_call_leaves_the_others_served(serve, connect):
    server = serve()
    sim = connect(server)
    sim.setStepping(True)  # holds the simulation, so that the script's own step waits
    sim.startSimulation()
    script = f"""
        from coppeliasim_zmqremoteapi_client import RemoteAPIClient
        client = RemoteAPIClient(port={server.port})
        client.socket.LINGER = 0
        sim = client.require("sim")
        sim.setStepping(True)
        sim.setJointTargetVelocity(sim.getObject("/leftMotor"), 1.0)

        class Told:  # says when the request is sent and the answer is waited for
            def __init__(self, socket):
                self.socket = socket

            def __getattr__(self, name):
                return getattr(self.socket, name)

            def recv(self):
                print("stepping", flush=True)
                return self.socket.recv()

        client.socket = Told(client.socket)
        try:
            sim.step()
        except KeyboardInterrupt:
            try:
                sim.stopSimulation()
            except Exception as error:  # the socket still waits for its answer
                print(type(error).__name__, flush=True)
    """
    child = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "stepping\n"
    child.send_signal(signal.SIGINT)
    assert child.communicate(timeout=120)[0] == "ZMQError\n"
    sim.step()
    assert sim.getSimulationTime() == 0.05
    assert sim.getJointTargetVelocity(sim.getObject("/leftMotor")) == 1.0  # nobody stopped it


def test_a_script_that_starts_before_the_server_is_served(serve):
    with zmq.Context() as context, context.socket(zmq.REP) as probe:
        port = probe.bind_to_random_port("tcp://127.0.0.1", 20_000, 30_000)  # which no process is given by the system
    raw = Raw(type("Later", (), {"port": port}))
    raw.socket.send(cbor2.dumps({"uuid": "early", "func": "sim.getSimulationTime", "args": []}))
    with Server(make_world("empty"), port=port):
        assert raw.socket.poll(60_000)
        assert cbor2.loads(raw.socket.recv()) == {"ret": [0.0]}
    raw.close()


def test_wait_takes_the_steps_that_it_needs(serve, connect):
    sim = connect(serve())
    assert sim.wait(1.0) == 0.0  # stopped: at once
    sim.setStepping(True)
    sim.startSimulation()
    assert sim.wait(0.5) <= 0.0
    assert 0.5 <= sim.getSimulationTime() < 0.5 + 0.051
    sim.step()
    assert sim.getSimulationTime() < 0.5 + 0.101  # what the wait wanted is not left over
    assert sim.wait(0.01, False) <= 0.0


def test_pause_and_stop_pass_through_their_states(serve, connect):
    sim = connect(serve())
    sim.stopSimulation()
    sim.pauseSimulation()
    sim.step()  # stopped: none of them does anything
    assert sim.getSimulationState() == 0
    sim.setStepping(True)
    sim.startSimulation()
    sim.step()
    sim.pauseSimulation()
    states = []
    for _ in range(2):
        sim.step()
        states.append(sim.getSimulationState())
    assert states == [19, 8]
    paused = sim.getSimulationTime()
    sim.step()
    assert sim.getSimulationTime() == paused
    sim.startSimulation()
    assert sim.getSimulationState() == 20
    sim.step()
    assert sim.getSimulationState() == 17
    other = sim.client.__class__(port=sim.client.socket.getsockopt_string(zmq.LAST_ENDPOINT).rpartition(":")[2])
    other.require("sim").setStepping(True)
    sim.stopSimulation(True)
    assert sim.getSimulationState() == 0
    assert sim.getSimulationTime() == pytest.approx(paused + 0.05 * 4)
    assert sim.setStepping(True) == 0


# The command.


def test_a_second_server_on_the_port_is_one_line(serve):
    words = [sys.executable, "-m", "wayfield.bridges.coppelia", "--scene", "empty", "--port", str(serve().port)]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert "cannot be served" in ended.stderr


@pytest.mark.parametrize(
    ("option", "words"),
    [("--scene=nowhere", "nowhere"), ("--track=9", "--track"), ("--speed=-1", "--speed"), ("--robot=omni", "omni3")],
)
def test_a_wrong_option_is_one_line(option, words):
    from wayfield.bridges.coppelia.__main__ import main

    with pytest.raises(SystemExit) as ended:
        main([option])
    assert ended.value.code == 2
    assert words


def test_the_server_is_bound_to_this_machine_and_ends_on_ctrl_c():
    words = [sys.executable, "-m", "wayfield.bridges.coppelia", "--scene", "empty", "--port", "0"]
    child = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    line = child.stderr.readline()
    assert "127.0.0.1" in line
    child.send_signal(signal.SIGINT)
    assert child.wait(timeout=120) == 0
    assert child.stderr.read().count("\n") == 1
    child.stderr.close()


def test_scenes_are_loaded_by_name_alone(serve, connect, tmp_path):
    file = tmp_path / "own.json"
    file.write_text('{"goal": [1, 0, 0]}')
    sim = connect(serve(load=lambda name: make_world(name, Conditions(), files=False)))
    for name in (str(file), "scene.ttt", "clutter_10/train"):
        with pytest.raises(Exception, match="could not be loaded"):
            sim.loadScene(name)
    sim.loadScene("apf_1")
    assert sim.getObject("/Goal") > 0
    sim.startSimulation()
    with pytest.raises(Exception, match="simulation is not stopped"):
        sim.loadScene("empty")
