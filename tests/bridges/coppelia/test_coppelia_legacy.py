"""Scripts for the legacy remote API, as people write them for the P3DX, against the server through the stand-in."""

import itertools
import os
import subprocess
import sys
import textwrap

import pytest

pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("coppeliasim_zmqremoteapi_client", reason='needs pip install "wayfield[coppelia]"')

OPENING = """
import math, sys, time
import MODULE as sim

sim.simxFinish(-1)
clientID = sim.simxStart('127.0.0.1', 19999, True, True, 5000, 5)
if clientID == -1:
    sys.exit('Could not connect')
"""
HANDLES = """
_, robot = sim.simxGetObjectHandle(clientID, 'Pioneer_p3dx', sim.simx_opmode_oneshot_wait)
_, left = sim.simxGetObjectHandle(clientID, 'Pioneer_p3dx_leftMotor', sim.simx_opmode_blocking)
_, right = sim.simxGetObjectHandle(clientID, 'Pioneer_p3dx_rightMotor', sim.simx_opmode_blocking)
"""


# as CoppeliaSim's own module, where its library is not
THEIRS = """
def simxStart(*args):
    raise OSError("remoteApi.so: cannot open shared object file")
simxFinish = simxStart
"""


@pytest.fixture(params=["alone"])
def run(tmp_path, request):
    """Returns what runs a script beside the stand-in, and gives what it prints."""
    if request.param == "beside":
        (tmp_path / "sim.py").write_text(THEIRS)
    words = [sys.executable, "-m", "wayfield.bridges.coppelia", "--legacy", str(tmp_path)]
    subprocess.run(words, check=True, capture_output=True)

    def ran(body, server, module="sim", handles=HANDLES):
        script = tmp_path / "script.py"
        script.write_text(OPENING.replace("MODULE", module) + handles + textwrap.dedent(body))
        address = {"WAYFIELD_COPPELIA": f"127.0.0.1:{server.port}"}
        words = [sys.executable, str(script)]
        done = subprocess.run(words, env=os.environ | address, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    return ran


def test_braitenberg_avoidance_streams_and_buffers(serve, run):
    server = serve("arena", speed=10.0)
    nearest, met = run(
        """
        sonars = []
        for i in range(1, 9):
            name = 'Pioneer_p3dx_ultrasonicSensor' + str(i)
            ret, handle = sim.simxGetObjectHandle(clientID, name, sim.simx_opmode_blocking)
            assert ret == sim.simx_return_ok
            sonars.append(handle)
            sim.simxReadProximitySensor(clientID, handle, sim.simx_opmode_streaming)
        sim.simxStartSimulation(clientID, sim.simx_opmode_oneshot)
        nearest, met = 1.0, 0
        began = time.time()
        while met < 20 and time.time() - began < 60:
            weights_l = [-0.2, -0.4, -0.6, -0.8, -1.0, -1.2, -1.4, -1.6]
            v_left = v_right = 2.0
            for i, handle in enumerate(sonars):
                ret, state, point, obj, normal = sim.simxReadProximitySensor(clientID, handle, sim.simx_opmode_buffer)
                if ret == sim.simx_return_ok and state:
                    dist = math.sqrt(sum(c * c for c in point))
                    nearest, met = min(nearest, dist), met + 1
                    near = 1 - (max(dist, 0.2) - 0.2) / 0.8
                    v_left += 3 * weights_l[i] * near
                    v_right += 3 * weights_l[7 - i] * near
            sim.simxSetJointTargetVelocity(clientID, left, v_left, sim.simx_opmode_streaming)
            sim.simxSetJointTargetVelocity(clientID, right, v_right, sim.simx_opmode_streaming)
        sim.simxStopSimulation(clientID, sim.simx_opmode_oneshot)
        sim.simxGetPingTime(clientID)
        sim.simxFinish(clientID)
        print(nearest, met)
        """,
        server,
    )
    assert int(met) > 0
    assert 0.05 <= float(nearest) < 1.0


def test_go_to_a_point_in_synchronous_mode(serve, run):
    x, y, t = map(
        float,
        run(
            """
            goal = (1.5, 1.0)
            vrep = sim
            assert vrep.simxSynchronous(clientID, True) == vrep.simx_return_ok
            vrep.simxStartSimulation(clientID, vrep.simx_opmode_blocking)
            for k in range(400):
                _, (x, y, _) = vrep.simxGetObjectPosition(clientID, robot, -1, vrep.simx_opmode_oneshot_wait)
                _, (_, _, yaw) = vrep.simxGetObjectOrientation(clientID, robot, -1, vrep.simx_opmode_oneshot_wait)
                rho = math.hypot(goal[0] - x, goal[1] - y)
                if rho < 0.05:
                    break
                turn = (math.atan2(goal[1] - y, goal[0] - x) - yaw + math.pi) % (2 * math.pi) - math.pi
                v, w = min(0.4, rho) * math.cos(turn), 1.5 * turn
                vrep.simxSetJointTargetVelocity(clientID, left, (v - 0.1655 * w) / 0.0975, vrep.simx_opmode_oneshot)
                vrep.simxSetJointTargetVelocity(clientID, right, (v + 0.1655 * w) / 0.0975, vrep.simx_opmode_oneshot)
                vrep.simxSynchronousTrigger(clientID)
                vrep.simxGetPingTime(clientID)
            print(x, y, vrep.simxGetLastCmdTime(clientID) / 1000 - k * 0.05)
            vrep.simxStopSimulation(clientID, vrep.simx_opmode_blocking)
            """,
            serve("empty"),
            module="vrep",
        ),
    )
    assert (x, y) == pytest.approx((1.5, 1.0), abs=0.05)
    assert t == pytest.approx(0.0, abs=2e-3)


def test_a_pose_logger_streams_until_somebody_stops(serve, run):
    lines = run(
        """
        from threading import Thread
        sim.simxSetJointTargetVelocity(clientID, left, 2, sim.simx_opmode_oneshot)
        sim.simxSetJointTargetVelocity(clientID, right, 2, sim.simx_opmode_oneshot)
        ret, pos = sim.simxGetObjectPosition(clientID, robot, -1, sim.simx_opmode_buffer)
        assert (ret, pos) == (sim.simx_return_novalue_flag, [0.0, 0.0, 0.0])
        ret, pos = sim.simxGetObjectPosition(clientID, robot, -1, sim.simx_opmode_streaming + 10)
        assert ret == sim.simx_return_novalue_flag
        sim.simxStartSimulation(clientID, sim.simx_opmode_oneshot)
        Thread(target=lambda: (time.sleep(1.0), sim.simxStopSimulation(clientID, sim.simx_opmode_oneshot))).start()
        time.sleep(0.1)
        while sim.simxGetInMessageInfo(clientID, sim.simx_headeroffset_server_state)[1] & 1:
            ret, pos = sim.simxGetObjectPosition(clientID, robot, -1, sim.simx_opmode_buffer)
            ret2, lin, ang = sim.simxGetObjectVelocity(clientID, robot, sim.simx_opmode_blocking)
            assert ret == ret2 == sim.simx_return_ok
            print(pos[0])
            time.sleep(0.02)
        assert sim.simxGetObjectPosition(clientID, robot, -1, sim.simx_opmode_discontinue)[0] == sim.simx_return_ok
        ret, pos = sim.simxGetObjectPosition(clientID, robot, -1, sim.simx_opmode_buffer)
        assert ret == sim.simx_return_novalue_flag
        """,
        serve("empty", speed=2.0),
    )
    places = [float(line) for line in lines]
    driven = [b - a for a, b in itertools.pairwise(places)]
    assert len(places) > 5
    assert places[-2] > 0.05
    assert sum(each >= 0.0 for each in driven) >= len(driven) - 1  # but for the stop


def test_signals_and_the_lidar_are_read_as_bytes_and_what_is_missing_is_an_error(serve, run):
    assert run(
        """
        sim.simxStartSimulation(clientID, sim.simx_opmode_blocking)
        time.sleep(0.3)
        code = 1
        while code != 0:
            code, ranges = sim.simxGetStringSignal(clientID, 'hokuyo_range_data', sim.simx_opmode_streaming)
        code, angles = sim.simxGetStringSignal(clientID, 'hokuyo_angle_data', sim.simx_opmode_blocking)
        ranges, angles = sim.simxUnpackFloats(ranges), sim.simxUnpackFloats(angles)
        assert len(ranges) == len(angles) == 684 and min(ranges) > 0.1
        assert sim.simxGetIntegerSignal(clientID, 'count', sim.simx_opmode_blocking) == (8, 0)
        sim.simxSetIntegerSignal(clientID, 'count', 3, sim.simx_opmode_oneshot)
        sim.simxSetFloatSignal(clientID, 'gain', 0.5, sim.simx_opmode_oneshot)
        sim.simxSetStringSignal(clientID, 'word', sim.simxPackFloats([1.0, 2.5]), sim.simx_opmode_blocking)
        assert sim.simxGetIntegerSignal(clientID, 'count', sim.simx_opmode_blocking) == (0, 3)
        assert sim.simxGetFloatSignal(clientID, 'gain', sim.simx_opmode_blocking) == (0, 0.5)
        code, word = sim.simxGetAndClearStringSignal(clientID, 'word', sim.simx_opmode_blocking)
        assert sim.simxUnpackFloats(word) == [1.0, 2.5]
        assert sim.simxGetStringSignal(clientID, 'word', sim.simx_opmode_blocking)[0] == 8
        assert sim.simxGetObjectHandle(clientID, 'nobody', sim.simx_opmode_blocking) == (8, 0)
        try:
            sim.simxGetVisionSensorImage(clientID, 1, 0, sim.simx_opmode_streaming)
        except AttributeError as error:
            assert 'simxGetVisionSensorImage: images' in str(error)
        sim.simxFinish(clientID)
        assert sim.simxGetPingTime(clientID)[0] == sim.simx_return_initialize_error_flag
        assert sim.simxGetConnectionId(clientID) == -1
        print('done')
        """,
        serve("document-a", speed=1.0),
    ) == ["done"]


@pytest.mark.parametrize("run", ["alone", "beside"], indirect=True)
def test_the_first_script_of_coppeliasim_runs_beside_its_own_module_too(serve, run, tmp_path):
    """Objects counted, the mouse asked for, a message: each has a return code."""
    assert run(
        """
        code, objects = sim.simxGetObjects(clientID, sim.sim_handle_all, sim.simx_opmode_blocking)
        assert code == sim.simx_return_ok and len(objects) > 5
        code, x = sim.simxGetIntegerParameter(clientID, sim.sim_intparam_mouse_x, sim.simx_opmode_streaming)
        assert code == sim.simx_return_novalue_flag
        code, x = sim.simxGetIntegerParameter(clientID, sim.sim_intparam_mouse_x, sim.simx_opmode_buffer)
        assert code in (sim.simx_return_ok, sim.simx_return_remote_error_flag), code
        sim.simxAddStatusbarMessage(clientID, 'Hello CoppeliaSim!', sim.simx_opmode_oneshot)
        assert sim.simxGetPingTime(clientID)[0] == sim.simx_return_ok
        sim.simxFinish(clientID)
        print('ended')
        """,
        serve("empty"),
        handles="",
    ) == ["ended"]
    if (tmp_path / "sim").exists():
        assert (tmp_path / "sim.py").read_text() == THEIRS


def test_every_call_takes_the_numbers_of_numpy_as_those_of_python(serve, run):
    """NumPy 2.4 makes no number of an array of one by itself."""
    assert run(
        """
        import numpy as np
        once = sim.simx_opmode_blocking
        _, sonar = sim.simxGetObjectHandle(clientID, 'Pioneer_p3dx_ultrasonicSensor1', once)
        sim.simxSetFloatSignal(clientID, 'gain', 0.5, once)
        sim.simxSetIntegerSignal(clientID, 'count', 3, once)
        three, four = [0.1, 0.2, 0.3], [0.0, 0.0, 0.0, 1.0]
        calls = {'ObjectHandle': ['Pioneer_p3dx'], 'Objects': [1], 'ObjectGroupData': [1, 3], 'ObjectChild': [robot, 0]}
        calls |= {'IntegerParameter': [1], 'BooleanParameter': [25], 'FloatingParameter': [1]}
        calls |= {'ObjectParent': [left], 'ObjectVelocity': [robot], 'JointPosition': [left]}
        calls |= {'ObjectFloatParameter': [left, 2012], 'FloatSignal': ['gain'], 'IntegerSignal': ['count']}
        calls |= {'StringSignal': ['none'], 'AndClearStringSignal': ['none']}
        calls |= {'Object' + each: [robot, -1] for each in ('Position', 'Orientation', 'Quaternion')}
        calls = {'simxGet' + name: given for name, given in calls.items()}
        calls |= {'simxReadProximitySensor': [sonar], 'simxReadVisionSensor': [sonar], 'simxReadStringStream': ['none']}
        calls |= {'simxSetIntegerParameter': [1, 2], 'simxSetBooleanParameter': [25, 0], 'simxCreateDummy': [0.1, None]}
        calls |= {'simxSetJointTargetVelocity': [left, 1.0], 'simxSetJointForce': [left, 1.0]}
        calls |= {'simxSetJointMaxForce': [left, 1.0], 'simxSetFloatSignal': ['gain', 0.25]}
        calls |= {'simxSetIntegerSignal': ['count', 4], 'simxSetStringSignal': ['word', b'a'], 'simxRemoveObject': [-9]}
        calls |= {'simxSetObject' + each: [robot, -1, three] for each in ('Position', 'Orientation')}
        calls |= {'simxSetObjectQuaternion': [robot, -1, four], 'simxLoadScene': ['nowhere', 0]}
        calls |= {f'simxClear{each}Signal': ['none'] for each in ('Integer', 'Float', 'String')}
        calls |= {f'simx{each}Simulation': [] for each in ('Start', 'Pause', 'Stop')}
        calls |= {'simxAddStatusbarMessage': ['hello']}
        calls = {name: [clientID, *given, once] for name, given in calls.items()}
        calls |= {'simxGetConnectionId': [clientID], 'simxGetInMessageInfo': [clientID, 3]}
        calls |= {'simxPauseCommunication': [clientID, 1], 'simxSynchronous': [clientID, 1]}
        calls |= {'simxSynchronousTrigger': [9], 'simxGetPingTime': [9], 'simxGetLastCmdTime': [9], 'simxFinish': [9]}
        calls |= {'simxPackInts': [[1, 2]], 'simxPackFloats': [[1.0]]}
        calls |= {'simxUnpackInts': [b'abcd'], 'simxUnpackFloats': [b'abcd']}
        offered = {name for name in dir(sim) if name.startswith('simx') and callable(getattr(sim, name))}
        assert offered - set(calls) == {'simxStart'}, offered ^ set(calls)

        def of_numpy(value, kind):
            if isinstance(value, list):
                return kind[0](value)
            return kind[1](value) if isinstance(value, (int, float)) else value

        kinds = [(np.array, lambda x: np.array(x)[()]), (lambda x: np.array(x)[:, None], np.array)]
        kinds += [(lambda x: [np.array([each]) for each in x], lambda x: np.array([x]))]
        kinds += [(list, lambda x: np.array([[x]]))]
        for name, given in calls.items():
            found = [getattr(sim, name)(*(of_numpy(each, kind) for each in given)) for kind in kinds]
            plain = getattr(sim, name)(*given)
            if name != 'simxCreateDummy':
                assert all(repr(each) == repr(plain) for each in found), (name, plain, found)
        print('done')
        """,
        serve("empty"),
    ) == ["done"]


def test_nobody_there_is_minus_one_and_a_module_that_is_not_ours_stays(tmp_path):
    (tmp_path / "vrep.py").write_text("mine = 1\n")
    words = [sys.executable, "-m", "wayfield.bridges.coppelia", "--legacy", str(tmp_path)]
    refused = subprocess.run(words, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "vrep.py is there and not ours" in refused.stderr
    assert (tmp_path / "vrep.py").read_text() == "mine = 1\n"
    assert not (tmp_path / "sim.py").exists()
    subprocess.run([*words[:-1], str(tmp_path / "other")], check=True, capture_output=True)
    code = "import sim; print(sim.simxStart('127.0.0.1', 19999, True, True, 500, 5))"
    env = os.environ | {"WAYFIELD_COPPELIA": "127.0.0.1:1"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path / "other", env=env, capture_output=True, text=True, check=True
    )
    assert done.stdout == "-1\n"
