"""The client's side of the protocol in its smallest form, and what leaves a robot standing when its driver is gone.

The file also runs by itself, as a child that waits for the end of its parent: `plant` starts it so that a robot stops
even when the process that drives it is killed. It imports nothing of wayfield, to be there in a tenth of a second.
"""

import sys
import uuid
from typing import Any

import cbor2
import zmq

DONE = b"done"  # what a parent says that has stopped its robot itself


def encoded(message: dict[str, Any]) -> bytes:
    """Returns a message as CBOR; an exception that a signal raises meanwhile is never lost.

    Left to itself cbor2 asks of every list whether it is a Mapping, in Python, and drops what that raises: Ctrl-C at
    that moment would leave a robot driving on.
    """
    return bytes(cbor2.dumps(message, encoders={list: cbor2.CBOREncoder.encode_array}))


class Link:
    """A REQ socket to a CoppeliaSim; any call that gets no answer in time is one line and the end of the link.

    Args:
        address: "host:port".
        timeout: s, for an answer.

    Raises:
        ValueError: if the address is none.
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
        self._socket.connect(f"tcp://{address}")
        self._first: dict[str, Any] = {"ver": 2, "lang": "python", "timeout": 600}

    def call(self, function: str, *args: Any) -> Any:
        """Returns what a function of the simulator returns: None, a value, or a list of several.

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
        self._socket.send(encoded(fields))
        if not self._socket.poll(round(1000 * self.timeout)):
            raise ConnectionError(f"no answer from {self.address} to {request['func']} in {self.timeout:g} s")
        try:
            reply = cbor2.loads(self._socket.recv())
        except (cbor2.CBORDecodeError, ValueError):
            reply = None
        if not isinstance(reply, dict):
            raise ConnectionError(f"what answers at {self.address} is no CoppeliaSim")
        return reply

    def close(self) -> None:
        """Closes the socket, whatever state it is in."""
        self._context.destroy(linger=0)


def stand_still(address: str, joints: list[int], timeout: float = 2.0) -> None:
    """Stops a robot's wheels and the simulation, by a link of its own: the driver's may wait for an answer.

    Raises:
        ConnectionError: if nobody answers.
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
    """Waits until the parent has ended, and stops its robot unless the parent says that it did."""
    address, *joints = sys.argv[1:]
    if sys.stdin.buffer.read() != DONE:
        try:
            stand_still(address, [int(joint) for joint in joints])
        except (ConnectionError, RuntimeError) as error:
            sys.exit(str(error))


if __name__ == "__main__":
    main()
