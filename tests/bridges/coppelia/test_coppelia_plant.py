"""A CoppeliaSim as a plant, held to our own plants through the protocol; and what goes wrong, in one line each."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import gymnasium
import numpy as np
import pytest

pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')


PATH_FOLLOWING, GOAL_OBSTACLES = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveGoalObstacles-v0"
TRACK = 0.1905  # m, half of it: the task's robot
STATE = ("x", "y", "heading", "vx", "vy", "yaw_rate", "wheel_vx", "wheel_yaw_rate")


def address_of(server):
    return f"127.0.0.1:{server.port}"


def worst_difference(server, env_id, plant, steps, seed=3, **options):
    """Returns the largest difference of the two plants' states over random steps, and how many there were."""
    own = gymnasium.make(env_id, dynamics=plant, **options)
    other = gymnasium.make(env_id, dynamics="coppelia", address=address_of(server), **options)
    first, _ = own.reset(seed=seed)
    second, _ = other.reset(seed=seed)
    worst = float(np.abs(first - second).max())
    rng = np.random.default_rng(seed)
    try:
        for k in range(steps):
            if k % 10 == 0:
                action = (rng.uniform(-1.3, 1.3, 2) * [1.0, 4.0]).astype(np.float32)
            *_, ended, clocked, _ = own.step(action)
            assert other.step(action)[2:4] == (ended, clocked)
            mine, theirs = (env.unwrapped.batch.states[0] for env in (own, other))
            worst = max(worst, *(abs(float(mine[name] - theirs[name])) for name in STATE))
            if ended or clocked:
                break
    finally:
        other.close()
    return worst, k + 1


@pytest.fixture
def plain(tmp_path):
    """A path so wide that no robot leaves it."""
    file = tmp_path / "plain.json"
    file.write_text('{"path": [[-1000, 0], [1000, 0]], "start": [0, 0, 0.3], "corridor": 2000}')
    return str(file)


@pytest.mark.parametrize("plant", ["kinematic", "pymunk"])
def test_our_server_moves_as_our_plant_over_an_episode(serve, plain, plant):
    server = serve(dynamics=plant, half_track=TRACK)
    worst, steps = worst_difference(server, PATH_FOLLOWING, plant, 120, scenario=plain)
    assert steps == 120
    assert worst < 1e-9


def test_the_tiers_are_applied_before_the_simulator_and_every_episode_begins_at_rest(serve, plain):
    server = serve(half_track=TRACK)
    own = gymnasium.make(PATH_FOLLOWING, scenario=plain, actuators="lagged")
    other = gymnasium.make(
        PATH_FOLLOWING, scenario=plain, actuators="lagged", dynamics="coppelia", address=address_of(server)
    )
    for steps in (60, 10):  # the first leaves the wheels turning
        own.reset(seed=0)
        other.reset(seed=0)
        for k in range(steps):
            action = np.array([1.0, 2.0 * (-1) ** (k // 20)], np.float32)
            own.step(action)
            other.step(action)
            for name in ("x", "y", "heading"):
                mine, theirs = (env.unwrapped.batch.states[name][0] for env in (own, other))
                assert theirs == pytest.approx(mine, abs=1e-9), (name, k, steps)
    other.close()


@pytest.mark.parametrize("scenario", ["apf_0", "held_by_wall"])
def test_among_obstacles_contact_is_told_as_on_our_plant(serve, scenario):
    server = serve(scenario, half_track=TRACK)
    for seed in range(2):
        worst, _ = worst_difference(server, GOAL_OBSTACLES, "kinematic", 120, seed, scenario=scenario, num_beams=8)
        assert worst < 1e-9


def test_a_twist_is_driven_by_the_wheels_that_the_scene_has(serve, plain, caplog):
    env = gymnasium.make(PATH_FOLLOWING, scenario=plain, dynamics="coppelia", address=address_of(serve()))
    assert "half track 0.1655 m" in caplog.text
    env.reset(seed=0)
    env.step(np.array([0.5, 1.0], np.float32))
    s = env.unwrapped.batch.states[0]
    assert (s["vx"], s["yaw_rate"]) == pytest.approx((0.5, 1.0), abs=1e-9)
    env.close()


def test_smaller_steps_of_the_scene_make_up_a_control_period(serve, plain):
    worst, _ = worst_difference(serve(half_track=TRACK, dt=0.0125), PATH_FOLLOWING, "kinematic", 40, scenario=plain)
    assert worst < 1e-9


def test_odometry_is_that_of_the_wheels(serve, plain):
    worst, _ = worst_difference(
        serve(half_track=TRACK), PATH_FOLLOWING, "kinematic", 40, scenario=plain, pose_source="odometry", noise=1.0
    )
    assert worst < 1e-9


def test_a_policy_and_the_vector_environment_need_no_change(serve):
    from wayfield import policies
    from wayfield.policies import Pilot

    server = serve(half_track=TRACK)
    env = gymnasium.make_vec(
        PATH_FOLLOWING,
        1,
        vectorization_mode="vector_entry_point",
        scenario="straight_offset",
        dynamics="coppelia",
        address=address_of(server),
    )
    pilot = Pilot(policies.make("lookahead_retuned"), env)
    observations, _ = env.reset(seed=0)
    pilot.reset()
    for _ in range(100):
        observations, _, _, _, info = env.step(pilot.act(observations))
    assert abs(info["cross_track_error"][0]) < 0.15
    env.close()


def test_a_simulator_that_lets_its_client_wait_is_waited_for():
    """CoppeliaSim answers a step by "wait" until it has been made, where our server answers late."""
    import cbor2
    import zmq

    from wayfield.bridges.coppelia.standstill import Link

    heard = []
    with zmq.Context() as context, context.socket(zmq.REP) as simulator:
        port = simulator.bind_to_random_port("tcp://127.0.0.1")

        def answer():
            for reply in ({"func": "_*wait*_", "args": []}, {"func": "_*repeat*_", "args": []}, {"ret": [1, 2]}):
                heard.append(cbor2.loads(simulator.recv()))
                simulator.send(cbor2.dumps(reply))

        thread = threading.Thread(target=answer)
        thread.start()
        link = Link(f"127.0.0.1:{port}", 60.0)
        assert link.call("sim.step", True) == [1, 2]
        thread.join(60)
        link.close()
    assert [each["func"] for each in heard] == ["sim.step", "_*executed*_", "_*executed*_"]
    assert "ver" in heard[0]
    assert len({each["uuid"] for each in heard}) == 1


# What goes wrong.


def make(server, **options):
    return gymnasium.make(PATH_FOLLOWING, scenario="circle", dynamics="coppelia", address=address_of(server), **options)


@pytest.mark.slow
def test_a_missing_simulator_is_one_line():
    with pytest.raises(ConnectionError, match="no CoppeliaSim at localhost:1; start it, or `python -m"):
        gymnasium.make(PATH_FOLLOWING, dynamics="coppelia", address="localhost:1")


def test_a_scene_without_the_robot_and_a_step_that_does_not_divide_are_one_line(serve):
    with pytest.raises(RuntimeError, match="no robot /PioneerP3DX"):
        make(serve("document-b"))
    with pytest.raises(ValueError, match=r"time step of 0.03 s does not divide the control period of 0.05 s"):
        make(serve(dt=0.03))


@pytest.mark.parametrize(
    ("env_id", "options", "words"),
    [
        (PATH_FOLLOWING, {"address": "nowhere"}, "host:port"),
        (PATH_FOLLOWING, {"address": "localhost:1", "dynamics": "kinematic"}, "belongs to"),
        (PATH_FOLLOWING, {"shove": (1.0, 0.1, 0.0, 0.0)}, "no shove"),
        ("wayfield/OmniPathFollowing-v0", {}, "drives a differential drive; robot is 'omni3'"),
    ],
)
def test_what_cannot_be_driven_there_is_one_line(env_id, options, words):
    with pytest.raises(ValueError, match=words):
        gymnasium.make(env_id, **{"dynamics": "coppelia", **options})


def test_two_robots_are_refused(serve):
    with pytest.raises(ValueError, match="num_envs is 2"):
        gymnasium.make_vec(
            PATH_FOLLOWING, 2, vectorization_mode="vector_entry_point", dynamics="coppelia", address=address_of(serve())
        )


def standing(server):
    """Waits until the robot stands and the simulation has stopped."""
    began = time.monotonic()
    while server.world.state != 0 or server.world.targets.any():
        assert time.monotonic() - began < 60.0
        time.sleep(0.01)


def test_the_robot_is_left_standing_when_it_is_closed_and_when_it_is_forgotten(serve):
    server = serve()
    for let_go in ("close", "del"):
        env = make(server)
        env.reset(seed=0)
        env.step(np.array([0.5, 0.0], np.float32))
        assert server.world.state != 0
        if let_go == "close":
            env.close()
            standing(server)  # while it is still there: to forget it would be enough
        del env
        standing(server)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_the_robot_is_left_standing_however_its_driver_ends(serve, end):
    server = serve()
    script = f"""
        import gymnasium, numpy, wayfield.envs
        env = gymnasium.make("{PATH_FOLLOWING}", scenario="circle", dynamics="coppelia", address="{address_of(server)}")
        env.reset(seed=0)
        env.step(numpy.array([0.5, 0.0], numpy.float32))
        print("driving", flush=True)
        while True:
            env.step(numpy.array([0.5, 0.0], numpy.float32))
    """
    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert child.stdout.readline() == b"driving\n"
    os.kill(child.pid, end)
    child.wait(timeout=120)
    child.stdout.close()
    standing(server)


def test_the_command_writes_the_ordinary_tables_and_figures(serve, tmp_path, capsys):
    pytest.importorskip("matplotlib", reason='needs pip install "wayfield[evaluate]"')
    from wayfield.bridges.coppelia.evaluate import main

    server = serve("apf_1", half_track=TRACK)
    for scenario, policies, figure in (
        ("straight_offset", "lookahead_retuned,pure_pursuit", "path_trajectories.png"),
        ("apf_1", "apf_corrected", "goal_trajectories.png"),
    ):
        out = tmp_path / scenario
        words = ["--scenario", scenario, "--policies", policies, "--address", address_of(server), "--steps", "40"]
        with pytest.raises(SystemExit) as ended:
            main([*words, "--out", str(out)])
        assert ended.value.code == 0
        assert (out / figure).exists()
        assert (out / "episodes.csv").read_text().count("\n") == 1 + policies.count(",") + 1
    assert "coppelia" in capsys.readouterr().out


def test_the_command_names_what_is_wrong(capsys):
    from wayfield.bridges.coppelia.evaluate import main

    for words, text in (
        (["--scenario", "nowhere"], "'nowhere' is unknown"),
        (["--scenario", "circle", "--policies", "dwa"], "cannot do it"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2
        assert text in capsys.readouterr().err


def test_a_simulator_that_was_restarted_in_mid_episode_is_found_again_at_the_next_reset(plain):
    words = [
        sys.executable,
        "-m",
        "wayfield.bridges.coppelia",
        "--scene",
        "empty",
        "--speed",
        "0",
        "--track",
        "wayfield",
    ]

    def served(port):
        child = subprocess.Popen([*words, "--port", str(port)], stderr=subprocess.PIPE, text=True)
        line = next(line for line in child.stderr if " on 127.0.0.1:" in line)
        return child, int(line.rsplit(":", 1)[1])

    child, port = served(0)
    own = gymnasium.make(PATH_FOLLOWING, scenario=plain)
    env = gymnasium.make(PATH_FOLLOWING, scenario=plain, dynamics="coppelia", address=f"127.0.0.1:{port}")
    action = np.array([0.5, 0.3], np.float32)
    try:
        env.reset(seed=0)
        env.step(action)
        child.kill()
        child.wait()
        child.stderr.close()
        with pytest.raises(ConnectionError, match="closed the connection"):
            env.step(action)
        with pytest.raises(ConnectionError, match="earlier call"):
            env.step(action)
        child, _ = served(port)
        first, _ = own.reset(seed=0)
        again, _ = env.reset(seed=0)
        assert again == pytest.approx(first, abs=1e-6)
        for _ in range(10):
            assert env.step(action)[0] == pytest.approx(own.step(action)[0], abs=1e-6)
    finally:
        env.close()
        child.terminate()
        child.wait()
        child.stderr.close()
