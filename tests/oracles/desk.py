"""Functions of the server of CoppeliaSim's remote API, called without a socket between."""

import re

import numpy as np
import pytest

from wayfield.bridges.coppelia.scenes import Conditions, make_world
from wayfield.bridges.coppelia.server import Caller, Client, Server
from wayfield.bridges.coppelia.signatures import FUNCTIONS, NULL, CallError


class Desk:
    """A server that nobody serves, and a client whose calls are made at once."""

    def __init__(self, scene="empty", **conditions):
        self.server = Server(make_world(scene, Conditions(**conditions)), port=0, speed=0.0)
        self.client = Client("0123456789", "someone", 600.0)

    @property
    def world(self):
        return self.server.world

    def __getattr__(self, name):
        def call(*args):
            result = FUNCTIONS[f"sim.{name}"](Caller(self.server, self.client), list(args))
            return None if result is NULL else result

        return call

    def poses(self):
        return {node.handle: np.array(self.world.scene.pose(node)) for node in self.world.scene.objects.values()}


def refused(words, function, *args):
    with pytest.raises(CallError, match=re.escape(words)):
        function(*args)
