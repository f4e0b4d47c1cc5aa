"""Whole scripts, as people write them for CoppeliaSim, run as processes of their own against the server."""

import subprocess
import sys
import textwrap
import threading

import pytest

pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("coppeliasim_zmqremoteapi_client", reason='needs pip install "wayfield[coppelia]"')


def run(script, server):
    """Runs a script whose port is that of the server; returns what it prints."""
    words = textwrap.dedent(script).replace("PORT", str(server.port))
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


# Document A's law on document A's scene: a point ahead of the robot, its foot on the path, both shown by markers.
FOLLOWER = """
    import math
    import numpy as np
    from coppeliasim_zmqremoteapi_client import RemoteAPIClient

    client = RemoteAPIClient('localhost', PORT)
    sim = client.require('sim')
    sim.stopSimulation()
    client.setStepping(True)
    robot = sim.getObject('/PioneerP3DX')
    left, right = sim.getObject('./leftMotor'), sim.getObject('./rightMotor')
    ahead_marker, foot_marker, path = (sim.getObject(name) for name in ('/LH', '/Perp', '/Path'))
    table = np.array(sim.unpackDoubleTable(sim.readCustomDataBlock(path, 'PATH'))).reshape(-1, 7)
    points = table[:, :2]
    radius = sim.getShapeGeomInfo(sim.getObject('/PioneerP3DX/leftWheel'))[2][0] / 2
    apart = 2 * sim.getObjectPosition(left, robot)[1]
    trace = sim.addDrawingObject(sim.drawing_linestrip | sim.drawing_cyclic, 2, 0, -1, 500, [1, 0, 0])
    sim.startSimulation()
    errors = []
    while sim.getSimulationTime() < 30:
        x, y, z = sim.getObjectPosition(robot, sim.handle_world)
        yaw = sim.getObjectOrientation(robot, -1)[2]
        ahead = np.array([x + 0.4 * math.cos(yaw), y + 0.4 * math.sin(yaw)])
        i = int(np.hypot(*(points - ahead).T).argmin())
        j = (i + 2) % (len(points) - 1)
        tangent = math.atan2(*(points[j] - points[i])[::-1])
        dx, dy = ahead - points[i]
        side = -math.sin(tangent) * dx + math.cos(tangent) * dy
        turn = (tangent - yaw + math.pi) % (2 * math.pi) - math.pi
        v, w = 0.3 * math.cos(turn), 1.0 * turn - 10.0 * side
        sim.setJointTargetVelocity(left, (v - w * apart / 2) / radius)
        sim.setJointTargetVelocity(right, (v + w * apart / 2) / radius)
        sim.setObjectPosition(ahead_marker, -1, [*ahead.tolist(), 0.01])
        sim.setObjectPosition(foot_marker, -1, [*points[i].tolist(), 0.01])
        sim.addDrawingObjectItem(trace, [x, y, 0.02])
        client.step()
        errors.append(abs(side))
    assert np.allclose(sim.getObjectPosition(ahead_marker, -1)[:2], ahead)
    sim.stopSimulation(True)
    assert np.allclose(sim.getObjectPosition(foot_marker, -1)[:2], [-0.7, 1.2])
    print(np.median(errors[300:]))
"""


def test_a_path_follower_keeps_its_look_ahead_point_on_document_a_s_path(serve):
    assert float(run(FOLLOWER, serve("document-a"))) < 0.05


# Sixteen handles in an array of floats, free running, until somebody else stops the simulation.
WANDERER = """
    import time
    import numpy as np
    from coppeliasim_zmqremoteapi_client import RemoteAPIClient

    sim = RemoteAPIClient(port=PORT).getObject('sim')
    motors = [sim.getObject(f'/PioneerP3DX/{name}Motor') for name in ('left', 'right')]
    sonars = np.zeros(16)
    for i in range(16):
        sonars[i] = sim.getObject(f'/PioneerP3DX/ultrasonicSensor[{i}]')
    weights = np.array([0.6, 0.8, 1.0, 1.2, 1.3, 1.0, 0.8, 0.6])
    sim.startSimulation()
    print('running', flush=True)
    nearest, echoes = 1.0, 0
    while sim.getSimulationState() != sim.simulation_stopped:
        near = np.zeros(8)
        for i in range(8):
            res, dist, point, handle, normal = sim.readProximitySensor(float(sonars[i]))
            if res and dist > 0:
                near[i] = 1.0 - dist
                nearest = min(nearest, dist)
                echoes += 1
        turn = 8.0 * ((weights * near)[:4].sum() - (weights * near)[4:].sum())
        if near.max() > 0.4 and abs(turn) < 2.0:
            turn = 6.0
        sim.setJointTargetVelocity(motors[0], 3.0 * (1 - near.max()) + turn / 2)
        sim.setJointTargetVelocity(motors[1], 3.0 * (1 - near.max()) - turn / 2)
        time.sleep(0.001)
    print(nearest, echoes)
"""


def test_a_wanderer_avoids_walls_until_somebody_stops_it(serve, connect):
    server = serve("arena", speed=10.0)
    sim = connect(server)
    printed = []
    thread = threading.Thread(target=lambda: printed.append(run(WANDERER, server)))
    thread.start()
    while sim.getSimulationTime() < 10.0:
        sim.wait(0.2)  # not stepping: waits while the simulation runs by itself
        if not thread.is_alive():
            break
    moved = sim.getObjectPosition(sim.getObject("/PioneerP3DX"))
    sim.stopSimulation(True)
    thread.join(30)
    nearest, echoes = printed[0].split("\n")[1].split()
    assert abs(moved[0]) + abs(moved[1]) > 0.5
    assert int(echoes) > 0
    assert 0.05 <= float(nearest) <= 1.0
    assert sim.getObjectPosition(sim.getObject("/PioneerP3DX"))[:2] == pytest.approx([-0.0445, 0.0])


# The client's own habits: old style, a second client in a thread, sleeping, dummies made and removed.
VISITOR = """
    import threading
    import time
    from coppeliasim_zmqremoteapi_client import RemoteAPIClient

    sim = RemoteAPIClient(port=PORT).getObject('sim')
    idle = sim.getInt32Param(sim.intparam_idle_fps)
    sim.setInt32Param(sim.intparam_idle_fps, 0)
    assert sim.getInt32Param(sim.intparam_program_version) == 40900
    seen = []

    def watch():
        other = RemoteAPIClient(port=PORT).require('sim')
        while other.getSimulationState() == other.simulation_stopped:
            time.sleep(0.005)
        while other.getSimulationState() != other.simulation_stopped:
            seen.append(other.getSimulationTime())
            time.sleep(0.005)

    watcher = threading.Thread(target=watch)
    watcher.start()
    sim.startSimulation()
    while (t := sim.getSimulationTime()) < 2:
        sim.addLog(sim.verbosity_scriptinfos, f'{t:.2f} s')
        time.sleep(0.005)
    sim.stopSimulation()
    while sim.getSimulationState() != sim.simulation_stopped:
        time.sleep(0.005)
    watcher.join(10)
    assert seen and seen == sorted(seen), seen
    dummies = [sim.createDummy(0.01, 12 * [0.0]) for _ in range(50)]
    for i, dummy in enumerate(dummies):
        sim.setObjectPosition(dummy, -1, [0.01 * i, 0.01 * i, 0.01 * i])
    sim.removeObjects(dummies)
    sim.setInt32Param(sim.intparam_idle_fps, idle)
    print('done')
"""


def test_a_visitor_finds_its_habits_served(serve):
    assert run(VISITOR, serve("empty", speed=10.0)) == "done\n"
