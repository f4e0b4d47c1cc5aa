"""The server: one thread, one ROUTER socket, one loop over clients, stepping and the clock.

A pass of the simulation is made between messages. With stepping clients, all of them must request it; else it follows
the wall clock. A call that waits for a pass is answered after it, and clients see no difference from CoppeliaSim's
polling. Every other call is answered at once.
"""

import collections
import contextlib
import dataclasses
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import zmq
from zmq.utils.monitor import parse_monitor_message

from wayfield.bridges.coppelia.calls import NOT_OFFERED
from wayfield.bridges.coppelia.codec import MAX_MESSAGE, Refusal, Request, encoded, one_line, request_of
from wayfield.bridges.coppelia.signatures import FUNCTIONS, NULL, Callback, CallError, Wait
from wayfield.bridges.coppelia.world import World

LOG = logging.getLogger("wayfield.coppelia")

PORT = 23000
LOCAL = ("127.0.0.1", "localhost", "::1")

MAX_CLIENTS = 64  # over the limit, the client with the longest silence is dropped, stepping ones last
MAX_CALLBACKS = 32  # pending on one connection
_PATIENCE = 0.1  # s, the longest wait of the loop
_TIMEOUT = 600.0  # s, of silence, after which a client is dropped
_HANDSHAKE = 1000  # ms, for the ZeroMQ greeting
_QUEUE = 64  # frames of a connection, each way
_READ_WITHIN = 0.1  # s, for a peer with a full queue to make room, once


@dataclasses.dataclass(eq=False)
class Client:
    """A client, with all its connections."""

    uuid: str
    name: str  # for the log
    timeout: float
    connections: set[bytes] = dataclasses.field(default_factory=set)
    level: int = 0  # stepping level
    wish: bool = False  # whether it requests the next pass
    locks: int = 0
    heard: float = 0.0


class Connection:
    """A connection of a client."""

    def __init__(self, client: Client, descriptor: int) -> None:
        self.client = client
        self.descriptor = descriptor
        self.wait: Wait | None = None
        self.callbacks: collections.deque[Callback] = collections.deque(maxlen=MAX_CALLBACKS)


class Caller:
    """The context of a call: client, server and world."""

    __slots__ = ("client", "server", "world")

    def __init__(self, server: "Server", client: Client) -> None:
        self.server = server
        self.client = client
        self.world = server.world


class Server:
    """Serves a world on a port of this machine.

    Args:
        world: the scene and its robot.
        port: 0 takes a free port, which the attribute `port` then holds.
        speed: simulation seconds per second while no client steps; 0 or inf: no pacing.
        load: returns the world of a scene's name, for `sim.loadScene`; None: refused.
        real_time: whether stepped passes follow the wall clock as well, so that they can be watched.

    Raises:
        OSError: if the port is taken, or the address is not this machine's.
    """

    def __init__(
        self,
        world: World,
        host: str = "127.0.0.1",
        port: int = PORT,
        speed: float = 1.0,
        load: Callable[[str], World] | None = None,
        real_time: bool = False,
    ) -> None:
        self.world = world
        self.load = load
        self.speed = 0.0 if math.isinf(speed) else speed
        self.paced = self.speed > 0.0
        self.real_time = real_time
        self.host = host
        self.started = time.monotonic()
        self.stored: dict[tuple[int, str], int] = {}  # bytes of signals and blocks, by owner and name
        self.idle_fps = 0
        self._compile()
        self._clients: dict[str, Client] = {}
        self._connections: dict[bytes, Connection] = {}
        self._deaf: set[bytes] = set()  # identities of peers with full queues
        self._next_pass = 0.0
        self._next_look = 0.0
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._noted: dict[str, tuple[float, int]] = {}  # by kind of event: start of its second, and count
        self.lateness: collections.deque[float] = collections.deque(maxlen=10_000)  # s, of paced passes
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        try:
            self._bind(port)
        except BaseException:
            self._context.destroy(linger=0)
            raise

    def _bind(self, port: int) -> None:
        socket = self._socket
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.MAXMSGSIZE, MAX_MESSAGE),
            (zmq.HANDSHAKE_IVL, _HANDSHAKE),
            (zmq.RCVHWM, _QUEUE),
            (zmq.SNDHWM, _QUEUE),
            (zmq.ROUTER_MANDATORY, 1),  # a full queue is an error instead of a silent drop
            (zmq.TCP_KEEPALIVE, 1),
            (zmq.IPV6, int(":" in self.host)),
        ):
            socket.setsockopt(option, value)
        self._monitor = socket.get_monitor_socket(zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
        self._open: set[int] = set()  # descriptors of connections
        host = f"[{self.host}]" if ":" in self.host else self.host
        try:
            socket.bind(f"tcp://{host}:{port or '*'}")
        except zmq.ZMQError as error:
            raise OSError(error.errno, f"port {port} of {self.host} cannot be served: {error.strerror}") from None
        self.port = int(socket.getsockopt_string(zmq.LAST_ENDPOINT).rpartition(":")[2])
        self._poller = zmq.Poller()
        self._poller.register(socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)

    def _compile(self) -> None:
        """Compiles every kernel before the first client connects."""
        with contextlib.suppress(Refusal):
            request_of(b"\xa0")
        self.world.compile()

    # The loop.

    def serve(self, each: Callable[[], None] | None = None) -> None:
        """Serves until `stop`; calls `each` between passes, at least every 0.1 s."""
        try:
            while not self._stop.is_set():
                for socket, _ in self._poller.poll(math.ceil(1000.0 * self._patience())):
                    if socket is self._socket:
                        self._answer()
                    else:
                        self._drop_closed()
                now = time.monotonic()
                if now >= self._next_look:
                    self._next_look = now + 1.0
                    self._forget_silent(now)
                if self._due(now):
                    self._advance(now)
                self._release()
                if each is not None:
                    each()
        finally:
            self._socket.disable_monitor()
            self._monitor.close(0)
            self._context.destroy(linger=200)

    def stop(self) -> None:
        """Ends `serve`; safe from any thread."""
        self._stop.set()

    def close(self) -> None:
        """Ends the thread of the context manager."""
        self.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        elif not self._context.closed:
            self._context.destroy(linger=0)

    def __enter__(self) -> "Server":
        self._thread = threading.Thread(target=self.serve, name="wayfield-coppelia", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _patience(self) -> float:
        """Returns the timeout of the next poll, s."""
        now = time.monotonic()
        least = _PATIENCE
        for connection in self._connections.values():
            if connection.wait is not None:
                least = min(least, connection.wait.until - now)
        if self.world.running and not self._held():
            if self._stepping():
                due = max(self._next_pass - now, 0.0) if self.real_time else 0.0
                return due if self._wanted() else max(least, 0.0)
            least = min(least, self._next_pass - now if self.paced else 0.0)
        return max(least, 0.0)

    def _held(self) -> bool:
        return any(client.locks for client in self._clients.values())

    def _stepping(self) -> bool:
        return any(client.level for client in self._clients.values())

    def _wanted(self) -> bool:
        """Returns whether every stepping client requests the next pass."""
        return all(client.wish for client in self._clients.values() if client.level)

    def _due(self, now: float) -> bool:
        if not self.world.running or self._held():
            return False
        if self._stepping():
            return self._wanted() and (not self.real_time or now >= self._next_pass)
        return not self.paced or now >= self._next_pass

    def _advance(self, now: float) -> None:
        stepping = self._stepping()
        if self.paced and not stepping:
            self.lateness.append(now - self._next_pass)
        self.world.advance()
        for client in self._clients.values():
            client.wish = False
        self.schedule(now if stepping and not self.real_time else None)
        if not self.world.running:
            LOG.info("%s at %.2f s", "stopped" if self.world.state == 0 else "paused", self.world.time)

    def schedule(self, now: float | None = None) -> None:
        """Sets the time of the next paced pass: a period after the last one, or after `now`.

        After a stall the simulation catches up by one pass at most.
        """
        period = self.world.dt / self.speed if self.speed > 0.0 else self.world.dt
        self._next_pass = now + period if now is not None else max(self._next_pass + period, time.monotonic() - period)

    def _release(self) -> None:
        """Answers completed waits; waits over several passes request the next one."""
        for identity, connection in list(self._connections.items()):
            if connection.wait is None:
                continue
            results = connection.wait.done()
            if results is None:
                connection.client.wish |= connection.wait.steps
            else:
                connection.wait = None
                connection.client.heard = time.monotonic()
                self._send(identity, {"ret": results})

    # Messages.

    def _answer(self) -> None:
        """Answers one message; more would delay passes."""
        try:
            frames = self._socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return
        if len(frames) != 3 or len(frames[1]):
            self.log("dropped", "a message without the frames of a REQ socket")
            return
        identity = frames[0].bytes
        reply = self._reply(identity, frames[2])
        if reply is not None:
            self._send(identity, reply)
        connection = self._connections.get(identity)
        if connection is not None and connection.descriptor not in self._open:
            self._forget(identity)  # closed before its message was read

    def _send(self, identity: bytes, reply: dict[str, Any]) -> None:
        """Sends a reply; drops it for a peer that has gone or whose queue stays full."""
        message = [identity, b"", encoded(reply)]
        until = time.monotonic() + (0.0 if identity in self._deaf else _READ_WITHIN)
        while True:
            try:
                self._socket.send_multipart(message, zmq.NOBLOCK)
            except zmq.Again:
                if time.monotonic() < until:
                    # libzmq updates the state of the queue in this call
                    self._socket.getsockopt(zmq.EVENTS)
                    time.sleep(0.0005)
                    continue
                self._deaf.add(identity)
                self.log("dropped", "replies to a client that does not read them")
            except zmq.ZMQError:  # the peer has gone
                self._deaf.discard(identity)
            return

    def _reply(self, identity: bytes, frame: zmq.Frame) -> dict[str, Any] | None:
        """Returns the reply to a message; None where it comes later."""
        try:
            request = request_of(frame.bytes)
        except Refusal as refusal:
            self.log("refused", str(refusal))
            return refusal.reply
        connection = self._connection(identity, request, frame)
        # a new request on a waiting connection means that the client gave up the wait
        connection.wait = None
        try:
            return self._result(connection, request)
        except CallError as error:
            return {"err": f"in {one_line(request.func)}: {error}"}
        except Exception as error:  # a defect must not end the server
            LOG.exception("in %s: internal error", one_line(request.func))
            return {"err": f"in {one_line(request.func)}: internal error: {one_line(error)}"}

    def _connection(self, identity: bytes, request: Request, frame: zmq.Frame) -> Connection:
        """Returns the connection of a message; a new one with its client."""
        now = time.monotonic()
        connection = self._connections.get(identity)
        if connection is not None and connection.client.uuid != request.uuid:
            self._forget(identity)
            connection = None
        if connection is None:
            # a closed connection may have had the same descriptor
            self._drop_closed()
            client = self._clients.get(request.uuid)
            if client is None:
                self._make_room()
                client = Client(request.uuid, one_line(request.uuid, 8), request.timeout or _TIMEOUT)
                self._clients[request.uuid] = client
                self.log("connected", f"client {client.name}")
            connection = Connection(client, frame.get(zmq.SRCFD))
            client.connections.add(identity)
            self._connections[identity] = connection
        connection.client.heard = now
        return connection

    def _result(self, connection: Connection, request: Request) -> dict[str, Any] | None:
        """Returns the reply to a request; None where it comes later."""
        client, func, args = connection.client, request.func, request.args
        if func == "_*end*_":
            for identity in list(client.connections):
                self._forget(identity)
            return {}
        if func == "_*executed*_":
            if connection.callbacks:
                connection.callbacks.pop()
                return {"ret": args}
            return {"ret": []}
        function = FUNCTIONS.get(func)
        if function is None:
            reason = NOT_OFFERED.get(func)
            if reason is None:
                return {"err": f"No such function: {one_line(func)}"}
            return {"err": f"in {func}: not offered by wayfield's server: {reason}"}
        result = function(Caller(self, client), args)
        if result is None:
            return {"ret": []}
        if isinstance(result, tuple):
            return {"ret": list(result)}
        if isinstance(result, Wait):
            results = result.done()
            if results is not None:
                return {"ret": results}
            connection.wait = result
            return None
        if isinstance(result, Callback):
            connection.callbacks.append(result)
            return {"func": result.function, "args": result.args}
        return {"ret": [None if result is NULL else result]}

    # Clients come and go.

    def _drop_closed(self) -> None:
        """Drops closed connections."""
        while self._monitor.poll(0):
            event = parse_monitor_message(self._monitor.recv_multipart(zmq.NOBLOCK))
            descriptor = int(event["value"])
            if event["event"] == zmq.EVENT_ACCEPTED:
                self._open.add(descriptor)
                continue
            self._open.discard(descriptor)
            for identity in [i for i, each in self._connections.items() if each.descriptor == descriptor]:
                self._forget(identity)

    def _forget_silent(self, now: float) -> None:
        """Drops clients that are silent for longer than their timeout."""
        for client in [c for c in self._clients.values() if now - c.heard > c.timeout]:
            if not any(self._connections[i].wait for i in client.connections):
                for identity in list(client.connections):
                    self._forget(identity)

    def _forget(self, identity: bytes) -> None:
        """Drops a connection, and with its last one the client, its stepping and its locks."""
        connection = self._connections.pop(identity)
        client = connection.client
        client.connections.discard(identity)
        self._deaf.discard(identity)
        if client.connections:
            return
        del self._clients[client.uuid]
        if client.level or client.locks:
            self.schedule(time.monotonic())
        self.log("left", f"client {client.name}" + (", which stepped" if client.level else ""))

    def _make_room(self) -> None:
        """Drops the client with the longest silence, if the limit is reached."""
        if len(self._clients) < MAX_CLIENTS:
            return
        idle = [each for each in self._clients.values() if not each.level and not each.locks]
        silent = min(idle or self._clients.values(), key=lambda each: each.heard)
        for identity in list(silent.connections):
            self._forget(identity)

    def end_stepping(self) -> None:
        """Sets every client's stepping level to 0."""
        for client in self._clients.values():
            client.level, client.wish = 0, False
        self.schedule(time.monotonic())

    def replace(self, world: World) -> None:
        """Replaces the world; signals stay."""
        world.compile()
        world.signals, world.app_signals = self.world.signals, self.world.app_signals
        self.world = world
        self.stored = {key: size for key, size in self.stored.items() if key[0] <= 0}
        self.schedule(time.monotonic())

    def log(self, kind: str, what: str, a_second: int = 1) -> None:
        """Logs an event, at most `a_second` of its kind in a second: no client can fill the log."""
        now = time.monotonic()
        began, count = self._noted.get(kind, (now, 0))
        if now - began >= 1.0:
            began, count = now, 0
        self._noted[kind] = began, count + 1
        if count < a_second:
            LOG.info("%s: %s", kind, one_line(what, 1000))
