"""A minimal client of the protocol, and a watchdog that stops the robot when its driver ends.

The file also runs as a script: `plant` starts it as a child that waits for the end of its parent, so that the robot
stops even when the driving process is killed. It imports nothing of wayfield, to start in 0.1 s.
"""

import sys
import uuid
from typing import Any

import cbor2
import zmq

DONE = b"done"  # from a parent that has stopped its robot itself


def encoded(message: dict[str, Any]) -> bytes:
    """Returns a message as CBOR; an exception of a signal handler is never lost.

    By default cbor2 tests in Python whether a list is a Mapping, and drops exceptions of the test. Ctrl-C at that
    moment would leave the robot driving.
    """
    return bytes(cbor2.dumps(message, encoders={list: cbor2.CBOREncoder.encode_array}))


class Link:
    """A REQ socket to a CoppeliaSim; a call without an answer in time is an error and the end of the link.

    Args:
        address: "host:port".
        timeout: s, for an answer.

    Raises:
        ValueError: if the address is not host:port.
    """

    def __init__(self, address: str, timeout: float) -> None:
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise ValueError(f"address={address!r} must be host:port, such as localhost:23000")
        self.address = address
        self.timeout = timeout
        self.uuid = str(uuid.uuid4())
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._monitor = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._socket.connect(f"tcp://{address}")
        self.broken = False  # a call has failed: no further one is possible
        self._first: dict[str, Any] = {"ver": 2, "lang": "python", "timeout": 600}

    def call(self, function: str, *args: Any) -> Any:
        """Returns the result of a function of the simulator: None, a value, or a list of several.

        Raises:
            ConnectionError: if there is no answer.
            RuntimeError: if the simulator refuses.
        """
        request = {"func": function, "args": list(args)}
        while True:
            reply = self._ask(request)
            if "err" in reply:
                raise RuntimeError(f"the simulator at {self.address} refuses {function}: {reply['err']}")
            waits = reply.get("func")
            if waits is None:
                break
            if waits != "_*repeat*_":
                request = {"func": "_*executed*_", "args": []}
        if "ret" not in reply:
            raise ConnectionError(f"what answers at {self.address} speaks another version of the protocol")
        results = reply["ret"]
        return None if not results else results[0] if len(results) == 1 else results

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        fields = {**request, "argsL": len(request["args"]), "uuid": self.uuid, **self._first}
        self._first = {}
        if self.broken:
            raise ConnectionError(f"the link to {self.address} broke in an earlier call")
        self.broken = True
        self._socket.send(encoded(fields))
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._monitor, zmq.POLLIN)
        answers = dict(poller.poll(round(1000 * self.timeout)))
        if not answers:
            raise ConnectionError(f"no answer from {self.address} to {request['func']} in {self.timeout:g} s")
        if self._socket not in answers:
            raise ConnectionError(f"{self.address} closed the connection during {request['func']}")
        try:
            reply = cbor2.loads(self._socket.recv())
        except (cbor2.CBORDecodeError, ValueError):
            reply = None
        if not isinstance(reply, dict):
            raise ConnectionError(f"what answers at {self.address} is no CoppeliaSim")
        self.broken = False
        return reply

    def close(self) -> None:
        """Closes the socket, whatever state it is in."""
        if self._context.closed:
            return
        self._socket.disable_monitor()
        self._monitor.close(0)
        self._context.destroy(linger=0)


def stand_still(address: str, joints: list[int], timeout: float = 2.0) -> None:
    """Stops the wheels and the simulation over a link of its own: the driver's link may wait for an answer.

    Raises:
        ConnectionError: if there is no answer.
        RuntimeError: if the simulator refuses.
    """
    link = Link(address, timeout)
    try:
        for joint in joints:
            link.call("sim.setJointTargetVelocity", joint, 0.0)
        link.call("sim.stopSimulation")
    finally:
        link.close()


def main() -> None:
    """Waits for the end of the parent, and stops its robot unless the parent reports `DONE`."""
    address, *joints = sys.argv[1:]
    if sys.stdin.buffer.read() != DONE:
        try:
            stand_still(address, [int(joint) for joint in joints])
        except (ConnectionError, RuntimeError) as error:
            sys.exit(str(error))


if __name__ == "__main__":
    main()
