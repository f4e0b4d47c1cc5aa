"""The server of CoppeliaSim's remote API, its messages and its command, stated once more, with a clock set by hand."""

import math
import types

import numpy as np
import pytest

cbor2 = pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
zmq = pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')

from wayfield.envs.coppelia import calls_simulation, codec, server, standstill  # noqa: E402
from wayfield.envs.coppelia.scenes import Conditions, make_world  # noqa: E402
from wayfield.envs.coppelia.server import Client  # noqa: E402
from wayfield.envs.coppelia.signatures import FUNCTIONS, Callback, Wait  # noqa: E402
from wayfield.envs.robots import ROBOTS  # noqa: E402
from wayfield.envs.scenarios import TASKS, scenarios_of  # noqa: E402

# The server's clock and its clients, with a clock that is set by hand.


@pytest.fixture
def clock(monkeypatch):
    now = types.SimpleNamespace(at=100.0)
    kept = types.SimpleNamespace(monotonic=lambda: now.at, sleep=lambda s: setattr(now, "at", now.at + s))
    for module in (server, calls_simulation):
        monkeypatch.setattr(module, "time", kept)
    return now


def test_passes_are_due_by_the_clock_or_by_those_who_step(desk, clock):
    one = desk("empty")
    served, client = one.server, one.client
    served._clients[client.uuid] = client
    assert not served._due(clock.at)
    assert served._patience() == 0.1
    served.world.start()
    assert served._due(clock.at)  # as fast as it goes
    assert served._patience() == 0.0
    served.speed, served.paced = 2.0, True
    served.schedule(clock.at)
    assert served._next_pass == pytest.approx(100.025)
    assert not served._due(100.024)
    assert served._due(100.026)
    assert served._patience() == pytest.approx(0.025)
    clock.at = 100.03
    served._advance(clock.at)
    assert list(served.lateness) == [pytest.approx(0.005)]
    assert served._next_pass == pytest.approx(100.05)
    clock.at = 101.0
    served._advance(clock.at)  # after a stall it catches up by a pass alone
    assert served._next_pass == pytest.approx(100.975)
    clock.at = 100.0
    served.schedule(clock.at)
    client.locks = 1
    assert not served._due(200.0)
    assert served._patience() == 0.1
    client.locks, client.level = 0, 1
    assert not served._due(200.0)
    assert served._patience() == 0.1
    client.wish = True
    assert served._due(100.0)
    assert served._patience() == 0.0
    other = Client("9", "other", 600.0, level=1)
    served._clients["9"] = other
    assert not served._due(100.0)
    other.level = 0
    assert served._due(100.0)
    late = len(served.lateness)
    served._advance(clock.at)
    assert len(served.lateness) == late
    assert not client.wish
    assert served._next_pass == pytest.approx(100.025)
    client.level = 0
    served.paced = False
    served._advance(clock.at)  # as fast as it goes: there is no time at which it should have been
    assert len(served.lateness) == late
    served.paced = True
    served.schedule(clock.at)
    for name, args in (("releaseLock", []), ("setBoolParam", [25, True]), ("setStepping", []), ("startSimulation", [])):
        served._next_pass = 0.0
        if name == "startSimulation":
            served.world.state = 8  # paused
        getattr(one, name)(*args)
        assert served._next_pass == pytest.approx(100.025)
    client.level = other.level = 3
    served.end_stepping()
    assert (client.level, other.level) == (0, 0)


def connected(served, uuid, identity, descriptor=5, heard=0.0, timeout=600.0):
    client = served._clients.setdefault(uuid, Client(uuid, uuid, timeout, heard=heard))
    client.connections.add(identity)
    served._connections[identity] = server.Connection(client, descriptor)
    return client


def test_silent_clients_are_forgotten_when_they_wait_for_nothing(desk, clock):
    served = desk("empty").server
    quick, slow = connected(served, "a", b"1", timeout=5.0), connected(served, "b", b"2", timeout=50.0)
    waiting = connected(served, "c", b"3", timeout=5.0)
    connected(served, "c", b"4")
    served._connections[b"4"].wait = Wait(lambda: None, until=103.0)
    assert served._patience() == pytest.approx(0.1)
    clock.at = 102.95
    assert served._patience() == pytest.approx(0.05)
    clock.at = 104.0
    assert served._patience() == 0.0
    for client in (quick, slow, waiting):
        client.heard = 100.0
    served._forget_silent(105.0)
    assert set(served._clients) == {"a", "b", "c"}
    served._forget_silent(105.1)
    assert set(served._clients) == {"b", "c"}
    served._connections[b"4"].wait = None
    served._forget_silent(105.1)
    assert set(served._clients) == {"b"}
    assert set(served._connections) == {b"2"}
    served._forget_silent(150.1)
    assert not served._clients


def test_the_one_that_was_silent_longest_makes_room_if_it_holds_nothing(desk, monkeypatch):
    served = desk("empty").server
    monkeypatch.setattr(server, "MAX_CLIENTS", 3)
    for k, uuid in enumerate("abc"):
        connected(served, uuid, uuid.encode(), heard=float(k))
        served._make_room() if k < 2 else None
        assert uuid in served._clients
    served._clients["a"].level = served._clients["b"].locks = 1
    served._make_room()
    assert set(served._clients) == {"a", "b"}
    connected(served, "d", b"d", heard=9.0)
    served._clients["d"].level = 1
    served._make_room()
    assert set(served._clients) == {"b", "d"}


def test_a_waiting_call_is_answered_when_its_time_has_come(desk, clock, monkeypatch):
    served = desk("empty").server
    sent = []
    monkeypatch.setattr(served, "_send", lambda identity, reply: sent.append((identity, reply)))
    client = connected(served, "a", b"1")
    results = [None, None, [7]]
    served._connections[b"1"].wait = Wait(lambda: results.pop(0), steps=True)
    served._release()
    assert client.wish
    client.wish = False
    served._connections[b"1"].wait.steps = False
    served._release()
    assert not client.wish
    clock.at = 123.0
    served._release()
    assert sent == [(b"1", {"ret": [7]})]
    assert client.heard == 123.0
    assert served._connections[b"1"].wait is None
    served._release()
    assert len(sent) == 1


def test_who_asks_again_has_given_up_on_what_he_waited_for(desk, monkeypatch):
    served = desk("empty").server
    sent = []
    monkeypatch.setattr(served, "_send", lambda identity, reply: sent.append((identity, reply)))
    frame = types.SimpleNamespace(get=lambda option: 77)
    for func, reply in (
        ("sim.getSimulationState", {"ret": [0]}),
        ("sim.nothing", {"err": "No such function: "}),
        ("", {}),
    ):
        connected(served, "a", b"1", descriptor=77)
        served._connections[b"1"].wait = Wait(lambda: [7])
        frame.bytes = cbor2.dumps({"uuid": "a", "func": func, "args": []})
        found = served._reply(b"1", frame)
        assert set(found) == set(reply or {"err": ""})
        assert found == reply or func != "sim.getSimulationState"
        served._release()
        # a second answer would be taken for that to his next question; what is no request gives up nothing
        assert len(sent) == (not func), func


def test_a_request_gets_what_its_function_returns(desk, monkeypatch):
    served = desk("empty").server
    connected(served, "a", b"1")
    connected(served, "a", b"2")
    connection = served._connections[b"1"]

    def result(func, *args):
        return served._result(connection, codec.Request("a", func, list(args), None))

    wait = Wait(lambda: None)
    for returned, reply in (
        (None, []), (5, [5]), ((1, 2), [1, 2]), ([1, 2], [[1, 2]]), (server.NULL, [None]), (Wait(lambda: [3]), [3]),
    ):  # fmt: skip
        monkeypatch.setitem(FUNCTIONS, "sim.x", lambda caller, args, returned=returned: returned)
        assert result("sim.x") == {"ret": reply}
        assert connection.wait is None
    monkeypatch.setitem(FUNCTIONS, "sim.x", lambda caller, args: wait)
    assert result("sim.x") is None
    assert connection.wait is wait
    monkeypatch.setitem(FUNCTIONS, "sim.x", lambda caller, args: Callback("f", [*args, 1]))
    assert result("sim.x", 9) == {"func": "f", "args": [9, 1]}
    assert result("_*executed*_", 4, 5) == {"ret": [4, 5]}
    assert result("_*executed*_", 4, 5) == {"ret": []}
    assert result("sim.nothing") == {"err": "No such function: sim.nothing"}
    assert result(next(iter(server.NOT_OFFERED)))["err"].startswith("in sim.")
    assert result("_*end*_") == {}
    assert not served._clients
    assert not served._connections


def test_of_an_event_s_kind_only_so_many_a_second_are_logged(desk, clock, caplog):
    served = desk("empty").server
    with caplog.at_level("INFO", "wayfield.coppelia"):
        for at, what in ((0.0, "a"), (0.5, "b"), (0.99, "c"), (1.0, "d"), (1.5, "e")):
            clock.at = 200.0 + at
            served.log("kind", what)
            served.log("other", what, 2)
    lines = [record.getMessage() for record in caplog.records]
    assert lines == ["kind: a", "other: a", "other: b", "kind: d", "other: d", "other: e"]


# Messages.


def request(**fields):
    return cbor2.dumps({"uuid": "u", "func": "f", **fields})


def test_requests_are_read_within_their_limits():
    found = codec.request_of(request(args=[1, "a"], timeout=2.5, ver=2))
    assert found == ("u", "f", [1, "a"], 2.5)
    assert codec.request_of(request()) == ("u", "f", [], None)
    for timeout, kept in ((True, None), ("5", None), (0, None), (-1, None), (1e9, None), (5, 5), (0.1, 0.1)):
        assert codec.request_of(request(timeout=timeout)).timeout == kept
    for uuid in ("x", "x" * 256):
        assert codec.request_of(cbor2.dumps({"uuid": uuid, "func": "x" * 256})).uuid == uuid

    def nested(depth):
        value = []
        for _ in range(depth - 1):
            value = [value]
        return value

    assert codec.request_of(request(args=nested(31))).args == nested(31)
    for payload, words in (
        (request(args=nested(32)), "nested deeper than 32"),
        (cbor2.dumps({"uuid": "", "func": "f"}), "uuid must be a text of 1 to 256"),
        (cbor2.dumps({"uuid": "x" * 257, "func": "f"}), "uuid must be"),
        (cbor2.dumps({"uuid": 5, "func": "f"}), "uuid must be"),
        (cbor2.dumps({"uuid": "u", "func": ""}), "func must be a text of 1 to 256"),
        (cbor2.dumps({"uuid": "u", "func": "x" * 257}), "func must be"),
        (cbor2.dumps({"uuid": "u", "func": None}), "func must be"),
        (request(args={"a": 1}), "args must be an array"),
        (request(eval="1"), "nothing is evaluated"),
        (request(args=[1, {"a": [math.inf]}]), "argument 2 holds a number that is not finite"),
        (request(args=[1], other=math.nan), "the request holds a number that is not finite"),
        (cbor2.dumps([1]), "the message is no map"),
        (cbor2.dumps({"func": "f"}), "version does not match"),
        (b"\xa1\x61u\x62\xff\xff", "no CBOR of this protocol"),
        (b"", "it ends before it is complete"),
        (request() + b"\0", "more than it should"),
        (b"\x9f\xff", "indefinite length"),
        (b"\xc1\x01", "holds a tag"),
        (b"\xf7", "neither number"),
        (b"\xa1\x01\x01", "a key that is no text"),
        (b"\x3b" + b"\xff" * 8, "an integer below"),
        (b"\x7a\x00\x10\x00\x01" + b"x" * (2**20 + 1), "a text of more than 1,048,576 bytes"),
        (b"\x9a\x00\x0f\x42\x40" + b"\0" * 1_000_000, "more than 1,000,000 items"),
    ):
        with pytest.raises(codec.Refusal, match=words) as error:
            codec.request_of(payload)
        assert words in str(error.value.reply.get("err") or error.value.reply.get("error")) or "version" in words
        assert error.value.reply.get("success", False) is False
    assert codec.scan(np.frombuffer(b"\x7a\x00\x10\x00\x00" + b"x" * 2**20, np.uint8)) == 0
    assert codec.scan(np.frombuffer(b"\x9a\x00\x0f\x42\x3f" + b"\0" * 999_999, np.uint8)) == 0
    assert codec.scan(np.frombuffer(b"\x3b\x7f" + b"\xff" * 7, np.uint8)) == 0
    assert codec.scan(np.frombuffer(b"\x1b" + b"\xff" * 8, np.uint8)) == 0


def test_replies_that_cannot_be_sent_become_errors(monkeypatch):
    assert cbor2.loads(codec.encoded({"ret": [1, "a", None]})) == {"ret": [1, "a", None]}
    assert "cannot be encoded" in cbor2.loads(codec.encoded({"ret": [object()]}))["err"]
    monkeypatch.setattr(codec, "MAX_MESSAGE", 100)
    size = len(cbor2.dumps({"ret": [b"x" * 80]}))
    monkeypatch.setattr(codec, "MAX_MESSAGE", size)
    assert cbor2.loads(codec.encoded({"ret": [b"x" * 80]})) == {"ret": [b"x" * 80]}
    assert f"{size + 1:,} bytes" in cbor2.loads(codec.encoded({"ret": [b"x" * 81]}))["err"]
    assert codec.one_line(" a\tb\n\x07c ", 200) == "a b ?c"
    assert codec.one_line("x" * 200) == "x" * 200
    assert codec.one_line("x" * 201) == "x" * 199 + "…"


class Peer:
    """Stands in for a socket: keeps what is sent, and has its answers ready."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.sent = []

    def send(self, payload):
        self.sent.append(cbor2.loads(payload))

    def poll(self, within):
        self.within = within
        return bool(self.answers)

    def recv(self):
        answer = self.answers.pop(0)
        return answer if isinstance(answer, bytes) else cbor2.dumps(answer)


def link(*answers):
    made = standstill.Link("localhost:23000", 1.5)
    made._socket = Peer(*answers)
    return made


def test_the_client_s_side_asks_again_and_answers_callbacks():
    one = link(
        {"func": "_*repeat*_", "args": []}, {"func": "cb", "args": [1]}, {"ret": [4]}, {"ret": []}, {"ret": [1, 2]}
    )
    assert one.call("sim.x", 5, "a") == 4
    first, second, third = one._socket.sent
    assert first == {
        "func": "sim.x", "args": [5, "a"], "argsL": 2, "uuid": one.uuid, "ver": 2, "lang": "python", "timeout": 600,
    }  # fmt: skip
    assert second == {"func": "sim.x", "args": [5, "a"], "argsL": 2, "uuid": one.uuid}
    assert third == {"func": "_*executed*_", "args": [], "argsL": 0, "uuid": one.uuid}
    assert one._socket.within == 1500
    assert one.call("sim.y") is None
    assert one.call("sim.z") == [1, 2]
    for answers, kind, words in (
        ([], ConnectionError, r"no answer from localhost:23000 to sim.x in 1.5 s"),
        ([b"\xff"], ConnectionError, "is no CoppeliaSim"),
        ([[1]], ConnectionError, "is no CoppeliaSim"),
        ([{"success": True}], ConnectionError, "another version of the protocol"),
        ([{"err": "no"}], RuntimeError, "refuses sim.x: no"),
    ):
        with pytest.raises(kind, match=words):
            link(*answers).call("sim.x")
    for address in ("", "localhost", "localhost:", ":23000", "a:0", "a:65536", "a:x", "a:-1"):
        with pytest.raises(ValueError, match="must be host:port"):
            standstill.Link(address, 1.0)
    standstill.Link("a.b:65535", 1.0).close()


def test_a_robot_is_left_standing_by_a_link_that_is_closed(monkeypatch):
    made = []

    class Kept(standstill.Link):
        def __init__(self, address, timeout):
            super().__init__(address, timeout)
            self._socket = Peer(*([{"ret": [1]}] * 3 if not made else [{"err": "no"}]))
            made.append(self)

        def close(self):
            self.closed = True
            super().close()

    monkeypatch.setattr(standstill, "Link", Kept)
    standstill.stand_still("localhost:23000", [7, 8])
    asked = [(sent["func"], sent["args"]) for sent in made[0]._socket.sent]
    target = "sim.setJointTargetVelocity"
    assert asked == [(target, [7, 0.0]), (target, [8, 0.0]), ("sim.stopSimulation", [])]
    with pytest.raises(RuntimeError, match="refuses"):
        standstill.stand_still("localhost:23000", [7, 8])
    assert [each.closed for each in made] == [True, True]
    assert made[0].timeout == 2.0


def test_a_server_s_pace_and_its_next_pass(clock):
    for speed, kept, paced in ((math.inf, 0.0, False), (0.0, 0.0, False), (2.0, 2.0, True), (0.01, 0.01, True)):
        made = server.Server(make_world("empty"), port=0, speed=speed)
        assert (made.speed, made.paced) == (kept, paced)
        made.replace(make_world("empty"))
        assert made._next_pass == pytest.approx(100.0 + (0.05 / kept if kept else 0.05))
        clock.at = 100.0
        for change in (made.end_stepping, lambda made=made: made.replace(make_world("arena"))):
            made._next_pass = 0.0
            change()
            assert made._next_pass == pytest.approx(100.0 + (0.05 / kept if kept else 0.05))
        made.close()


def test_a_connection_is_its_client_s(desk, clock):
    served = desk("empty").server
    frame = types.SimpleNamespace(get=lambda option: 77)

    def come(identity, uuid, timeout=None):
        return served._connection(identity, codec.Request(uuid, "f", [], timeout), frame)

    clock.at = 5.0
    first = come(b"1", "a" * 20)
    assert (first.client.uuid, first.client.name, first.client.timeout) == ("a" * 20, "a" * 7 + "…", 600.0)
    assert (first.client.heard, first.descriptor, first.wait) == (5.0, 77, None)
    clock.at = 6.0
    second = come(b"2", "a" * 20, 9.0)
    assert second.client is first.client
    assert first.client.timeout == 600.0
    assert first.client.connections == {b"1", b"2"}
    assert first.client.heard == 6.0
    clock.at = 7.0
    assert come(b"1", "a" * 20) is first
    assert first.client.heard == 7.0
    other = come(b"1", "b", 9.0)  # gives up what the first one held
    assert other.client.timeout == 9.0
    assert first.client.connections == {b"2"}
    served._forget(b"2")
    assert set(served._clients) == {"b"}
    other.client.level = 1
    served._next_pass = 0.0
    served._forget(b"1")
    assert served._next_pass == pytest.approx(7.05)
    assert not served._clients


# The command.


def command(monkeypatch, *words):
    """Returns what the command would serve, and how."""
    from click.testing import CliRunner

    from wayfield.envs.coppelia import __main__ as program

    served = []

    class Kept:
        def __init__(self, *args):
            self.args, self.port = args, 5
            served.append(self)

        def serve(self, each):
            if each is not None:
                each()

        def stop(self):
            self.stopped = True

    handlers = {}
    monkeypatch.setattr(program, "Server", Kept)
    monkeypatch.setattr(program.signal, "signal", lambda number, handler: handlers.update({number: handler}))
    monkeypatch.setattr(program.logging, "basicConfig", lambda **_: None)
    result = CliRunner().invoke(program.main, list(words))
    if result.exit_code:
        return result.output
    (one,) = served
    assert set(handlers) == {program.signal.SIGINT, program.signal.SIGTERM}
    handlers[program.signal.SIGTERM](0, None)
    assert one.stopped
    return one.args


def test_the_command_serves_what_its_options_say(monkeypatch, caplog):
    with caplog.at_level("INFO", "wayfield.coppelia"):
        world, host, port, speed, load = command(monkeypatch)
    assert [r.getMessage() for r in caplog.records] == ["scene document-a, kinematic, on 127.0.0.1:5", "ended"]
    assert (world.scene.name, host, port, speed) == ("document-a", "127.0.0.1", 23000, 1.0)
    assert (world.dynamics, world.actuators, world.dt) == ("kinematic", "ideal", 0.05)
    assert world.model.robot.wheels[1].y == 0.1655
    assert load("empty").model.robot.wheels[1].y == 0.1655
    options = (
        "--scene arena --port 0 --host localhost --speed 0 --dynamics pymunk --actuators slow --dt 0.1 --track 0.2"
    )
    world, host, port, speed, load = command(monkeypatch, *options.split())
    assert (world.scene.name, host, port, speed) == ("arena", "localhost", 0, 0.0)
    for made in (world, load("empty")):
        assert (made.dynamics, made.actuators, made.dt) == ("pymunk", "slow", 0.1)
        assert made.model.robot.wheels[1].y == 0.2
    world, *_ = command(monkeypatch, "--track", "wayfield", "--robot", "p3dx")
    assert world.model.robot.wheels[1].y == ROBOTS["p3dx"].wheels[1].y == 0.1905
    world, *_, load = command(monkeypatch, "--scene", "moving_crossing/test", "--index", "2", "--robot", "omni4")
    bank = scenarios_of(TASKS["goal_reaching"], "moving_crossing/test", ROBOTS["omni4"].hull_radius)
    assert world.robot_pose == pytest.approx(bank[2].start)
    assert load("arena").model.robot.name == "omni4"
    with pytest.raises(ValueError, match="is unknown"):
        load("moving_crossing/test")
    with caplog.at_level("WARNING", "wayfield.coppelia"):
        command(monkeypatch, "--scene", "empty", "--host", "0.0.0.0")
    assert "the protocol knows no passwords" in caplog.text
    *_, load = command(monkeypatch, "--scene", "discs", "--index", "3")
    first, fourth = (make_world("discs", Conditions(number=k)).robot_pose for k in (0, 3))
    assert load("discs").robot_pose == first != fourth


def test_a_window_that_was_opened_is_shown_and_closed(monkeypatch):
    pytest.importorskip("pygame", reason='needs pip install "wayfield[render]"')
    from wayfield.envs.coppelia import window

    said = []

    class Kept:
        def __init__(self, mode="human"):
            said.append(mode)

        def show(self, served):
            said.append(served)

        def close(self):
            said.append("closed")

    monkeypatch.setattr(window, "Window", Kept)
    command(monkeypatch, "--scene", "empty", "--render", "human")
    assert (said[0], said[1].port, said[2]) == ("human", 5, "closed")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--track 0.01", "--track '0.01' must be a number from 0.02 to 1"),
        ("--track ours", "--track 'ours' must be a number"),
        ("--speed -1", "--speed '-1' must be a number from 0 to inf"),
        ("--speed nan", "--speed 'nan' must be a number"),
        ("--dt 0.0009", "--dt '0.0009' must be a number from 0.001 to 1"),
        ("--dt 1.1", "--dt '1.1' must be a number"),
        ("--scene nowhere.json", "cannot be read: No such file"),
        ("--scene moving_crossing/test --index 100000", "index is 100000"),
        ("--robot omni3 --track 0.2", "belongs to the p3dx"),
    ],
)
def test_the_command_s_bounds(monkeypatch, options, words):
    assert words in command(monkeypatch, *options.split())
