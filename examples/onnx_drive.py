"""A trained agent without wayfield's code: its network in onnxruntime, its features and actions in plain NumPy.

pip install -c constraints.txt ".[onnx]"; python examples/onnx_drive.py

    python -m wayfield.policies.learned.onnx FOLDER agent.onnx
    python onnx_drive.py agent.onnx

`Driver` needs the graph alone, which carries the agent's card: it turns a flat observation into a twist (v, w), for
path followers and for goal seekers of the frame "body", by the scan of the card. It is told what the base can do. Copy
it to your robot; here it drives our environment.
"""

import argparse
import json
import tempfile
from collections import deque
from pathlib import Path

import numpy as np
import onnxruntime


def clip(numbers):
    return np.clip(numbers, -5.0, 5.0)


class Driver:
    """Drives by a graph, from the beginning of an episode; `reset` at the next.

    The base accelerates by at most `acceleration` (m/s^2) and `yaw_acceleration` (rad/s^2), and lags by `lag` (s).
    A path follower makes up what it is late by in `pace_time` (s), and so holds the speed of its card as the mean.
    """

    def __init__(self, file, acceleration=1.0, yaw_acceleration=3.0, lag=0.1, pace_time=2.0):
        self.acceleration, self.yaw_acceleration, self.lag = acceleration, yaw_acceleration, lag
        self.session = onnxruntime.InferenceSession(str(file))
        self.card = json.loads(self.session.get_modelmeta().custom_metadata_map["card"])
        self.f, self.speed, self.pace_time = self.card["features"], self.card["speed"], pace_time
        self.see = self.path if self.card["task"] == "path_following" else self.goal
        self.reset()

    def reset(self):
        self.late, self.driven = -self.card["dt"] * self.card["speed"], 0.0  # m, and m/s the last time
        self.acted = np.zeros((self.f["previous"], 2))  # the latest first
        self.seen = deque([0.0] * ((self.f["frames"] - 1) * self.f["stride"]))  # the latest first
        self.points = None  # that trail behind
        self.places = []  # of the latest crumbs
        self.least = self.last = self.waited = 0.0  # m, m and s: the goal's distances, and since the least
        self.ages = np.zeros(2, np.float32)  # s, of two earlier scans
        self.older = self.newer = np.zeros((self.f.get("num_beams", 0), 2), np.float32)

    def act(self, observation):
        """Returns the twist (v, w), m/s and rad/s, for a flat observation; once a control period."""
        o = np.asarray(observation, float)
        now = self.see(o)
        old = [np.broadcast_to(each, now.shape) for each in list(self.seen)[self.f["stride"] - 1 :: self.f["stride"]]]
        inputs = [now, self.acted.ravel(), self.trails(o[:3]), self.crumbs(o), self.moving(o), *old, self.limits()]
        inputs = np.concatenate(inputs).astype(np.float32)
        (a,) = self.session.run(None, {"features": inputs[None]})[0]
        self.acted = np.vstack([a, self.acted[:-1]]) if len(self.acted) else self.acted
        if self.seen:
            self.seen.rotate(1)
            self.seen[0] = now
        reverse, yaw_rate = self.card["actions"]["reverse"], self.card["actions"]["yaw_rate"]
        twist = np.array([self.speed * (0.5 * (1.0 + reverse) * (a[0] + 1.0) - reverse), yaw_rate * a[1]])
        return twist if self.see == self.path else self.guarded(self.arrived(twist, o), o)

    def limits(self):
        """What the network sees of the base, where its card says that it does."""
        if not self.f["limits"]:
            return []
        scales = self.f["speed_scale"] / self.acceleration, self.f["yaw_scale"] / self.yaw_acceleration
        return np.minimum([*scales, self.lag / 0.1], 5.0)

    def motion(self, twist):
        return clip(twist / [self.f["speed_scale"], self.f["yaw_scale"]])

    def path(self, o):
        """Of a path follower: pose, twist, cross-track error, heading error, arc length, preview (n, 2)."""
        f, twist, e, turned, preview = self.f, o[3:5], o[5], o[6], o[8:].reshape(-1, 2)
        asked, driven = self.card["speed"], abs(twist[0])
        self.late += self.card["dt"] * (asked - 0.5 * (driven + self.driven))
        self.driven = driven
        most = max(asked, *self.card["trained_on"]["speeds"])
        self.speed = np.clip(asked + self.late / self.pace_time, 0.5 * asked, most)
        head = [np.arcsinh(e / f["error_scale"]), clip(e / (10 * f["error_scale"])), np.sin(turned), np.cos(turned)]
        # the turns of the path from point to point, from the nearest one on
        steps = np.diff(np.vstack([[-e * np.sin(turned), -e * np.cos(turned)], preview]), axis=0)
        turns, heading = [], -turned
        for dx, dy in steps:
            ahead = np.arctan2(dy, dx) if dx * dx + dy * dy > 1e-4 else heading
            turns.append((ahead - heading + np.pi) % (2 * np.pi) - np.pi)
            heading = ahead
        speed = [self.speed / f["speed_scale"]]
        near = clip(preview / f["preview_scale"]).ravel()
        return np.concatenate([head, speed, self.motion(twist), near, np.arcsinh(np.array(turns) / f["turn_scale"])])

    def goal(self, o):
        """Of a goal seeker: pose, twist, goal, its heading, waypoints left, ranges (n,) from the back on."""
        f, twist, goal, ranges = self.f, o[3:5], o[5:7], o[9:]
        distance, bearing = np.hypot(*goal), np.arctan2(goal[1], goal[0])
        near = [
            np.arcsinh(distance / f["distance_scale"]),
            distance / (distance + 0.2),
            np.sin(bearing),
            np.cos(bearing),
        ]
        nearest = ranges.reshape(-1, f["pool"]).min(axis=1) - f["hull_radius"]
        # how far a disc could go in each direction before it touches a point of the scan
        beams, radius = np.arange(len(ranges)), np.minimum(f["hull_radius"] + f["margin"], ranges)
        off = np.abs(beams - beams[:: f["pool"], None])
        off = np.minimum(off, len(ranges) - off)
        aside, ahead = (ranges * part(off * 2 * np.pi / len(ranges)) for part in (np.sin, np.cos))
        met = (off <= (len(ranges) - 1) // 4) & (aside < radius) & (ranges < f["max_range"])
        way = np.where(met, ahead - np.sqrt(np.maximum(radius**2 - aside**2, 0.0)), f["max_range"]).min(axis=1)
        room = np.maximum(np.concatenate([nearest, way]), 0.0)
        speed = [self.speed / f["speed_scale"]]
        return np.concatenate([near, speed, self.motion(twist), f["range_scale"] / (f["range_scale"] + room)])

    def trails(self, pose):
        """Points that trail behind, each drawn on by its own time."""
        times = np.array(self.f["trails"], float)[:, None]
        if not len(times):
            return []
        before = np.tile(pose[:2], (len(times), 1)) if self.points is None else self.points
        self.points = before + (1.0 - np.exp(-self.card["dt"] / times)) * (pose[:2] - before)
        (s, c), away = (np.sin(pose[2]), np.cos(pose[2])), self.points - pose[:2]
        return clip(away @ [[c, -s], [s, c]] / (self.f["speed_scale"] * times)).ravel()

    def crumbs(self, o):
        """What a goal seeker knows of where it was, and of the goal that it comes no nearer."""
        if not self.f.get("crumbs"):
            return []
        at, heading, distance = o[:2], o[2], np.float32(np.hypot(*o[5:7]))
        if not self.places or distance < self.least or distance > self.last + 0.5:
            self.least, self.waited = distance, 0.0
        else:
            self.waited += self.card["dt"]
        self.last = distance
        if not self.places or np.hypot(*(at - self.places[-1])) >= self.f["crumb_gap"]:
            self.places = [*self.places, at.astype(np.float32)][-self.f["crumbs"] :]
        near = np.zeros(self.f["num_beams"] // self.f["pool"])
        for dx, dy in np.array(self.places, float) - at:
            k = int(np.floor((np.arctan2(dy, dx) - heading) / (2 * np.pi) * len(near) + 0.5)) % len(near)
            near[k] = max(near[k], self.f["range_scale"] / (self.f["range_scale"] + np.hypot(dx, dy)))
        return [np.arcsinh(distance - self.least), self.waited / (self.waited + 5.0), *near]

    def moving(self, o):
        """How fast what a goal seeker sees comes nearer by itself, and how near it will be in 1.2 s."""
        if not self.f.get("moving"):
            return []
        ranges, hull, pool = o[9:], self.f["hull_radius"], self.f["pool"]
        step, count = 2 * np.pi / len(ranges), len(ranges) // pool
        self.ages += np.float32(self.card["dt"])
        taken = self.ages[1] >= 0.2 - 0.5 * self.card["dt"]
        if taken:
            self.older, self.newer = self.newer, np.full_like(self.newer, np.nan)
            self.ages = np.array([self.ages[1], 0.0], np.float32)
        age = float(self.ages[0])
        towards = np.arange(len(ranges)) * step - np.pi + o[2]
        towards = np.column_stack([np.cos(towards), np.sin(towards)])
        hits = o[:2] + ranges[:, None] * towards
        met = (ranges > 0.0) & (ranges < (1.0 - 1e-6) * self.f["max_range"])
        if taken:
            self.newer[met] = hits[met]
        lines = self.older.astype(float)
        along = np.roll(lines, -1, axis=0) - lines
        closing, foreseen = np.zeros(count), np.zeros(count)
        with np.errstate(invalid="ignore", divide="ignore"):
            length = (along**2).sum(axis=1)
            for k in np.flatnonzero(met & (ranges <= 3.5) & (ranges > hull)):
                off = hits[k] - lines
                across, part = off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0], (off * along).sum(axis=1)
                one = (
                    (length > 0.0) & (length < 0.16) & (part >= 0.0) & (part <= length) & (across**2 < age**2 * length)
                )
                if not one.any():
                    continue
                n = np.argmin(np.where(one, across**2 / length, np.inf))
                moved = across[n] / length[n] * np.array([along[n, 1], -along[n, 0]])
                nearer = -moved @ towards[k]
                if abs(nearer) > 0.03 and abs(nearer) > age * abs(closing[k // pool]):
                    closing[k // pool] = nearer / age
                if nearer > 0.06:
                    ahead = min(1.2 / age, (ranges[k] - hull) / np.hypot(*moved))
                    then = ranges[k] * towards[k] + ahead * moved
                    away = max(np.hypot(*then), 1e-6)
                    half = np.arcsin(min((hull + self.f["margin"]) / away, 1.0)) / (pool * step)
                    middle = ((np.arctan2(then[1], then[0]) - o[2]) % (2 * np.pi) - np.pi) % (2 * np.pi) / (pool * step)
                    near = self.f["range_scale"] / (self.f["range_scale"] + max(away - hull, 0.0))
                    for j in range(int(np.ceil(middle - half - 0.5)), int(np.floor(middle + half + 0.5)) + 1):
                        foreseen[j % count] = max(foreseen[j % count], near)
        return [*closing, *foreseen]

    def arrived(self, twist, o):
        """Near its last goal, a goal seeker drives on to it and turns to its heading by a law."""
        (x, y), turn, left = o[5:7], o[7], o[8]
        distance = np.hypot(x, y)
        if left > 0.5 or distance > self.f["arrival"]:
            return twist
        there = distance <= 0.03 and (distance <= 0.015 or x <= 0.0)
        aside = np.arctan2(y, x)
        error = turn if there else aside
        hardest = 0.5 * min(self.yaw_acceleration, 3.0)
        rate = np.sign(error) * min(2.0 * abs(error), np.sqrt(2.0 * hardest * abs(error)), 1.5)
        speed = 0.0 if there or abs(aside) >= 0.3 else min(self.speed, 0.3, 1.5 * distance)
        return np.array([speed, rate])

    def guarded(self, twist, o):
        """A goal seeker approaches what it sees no faster than it could stop."""
        if not self.f["braking"]:
            return twist
        braking, reaction = min(self.f["braking"], 0.7 * self.acceleration), max(self.f["reaction"], self.lag + 0.1)
        late = reaction - self.f["reaction"] + self.speed / braking - self.speed / self.f["braking"]
        room = np.maximum(o[9:] - self.f["hull_radius"] - self.f["gap"], 0.0)
        angles = np.arange(len(room)) * 2 * np.pi / len(room) - np.pi
        # as it heads, and as it will have turned by the time that it needs longer to stop than it was trained with
        turned = np.clip(late * max(twist[1], o[4], key=abs), -np.pi / 2, np.pi / 2)
        near = np.clip(angles, min(turned, 0.0), max(turned, 0.0))
        towards = twist[0] * np.cos(angles - near)
        most = braking * (np.sqrt(reaction**2 + 2 * room / braking) - reaction)
        fast = towards > np.maximum(most, 0.0)
        return twist * [np.min(most[fast] / towards[fast], initial=1.0), 1.0]


def main() -> None:
    import gymnasium

    import wayfield  # noqa: F401  registers the ids

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="?", help="default: an agent that ships is exported")
    parser.add_argument("--steps", type=int, default=2_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = options.file or exported(Path(folder) / "agent.onnx")
        driver = Driver(file)
    env = gymnasium.make(driver.card["env_id"], **driver.card["env_kwargs"])
    observation, _ = env.reset(seed=0)
    arrived = episodes = 0
    for _ in range(options.steps):
        twist = np.clip(driver.act(observation), env.action_space.low, env.action_space.high)
        observation, _, terminated, truncated, info = env.step(twist.astype(np.float32))
        if terminated or truncated:
            episodes += 1
            arrived += info["success"]
            observation, _ = env.reset()
            driver.reset()
    print(f"{arrived} of {episodes} episodes succeeded; {options.steps} steps")


def exported(file):
    """Writes the first path follower that ships."""
    from wayfield.policies import load_agent
    from wayfield.policies.learned.onnx import export_onnx
    from wayfield.policies.trained.ppo import shipped

    export_onnx(load_agent(shipped("path_following", "p3dx")[0]), file)
    return file


if __name__ == "__main__":
    main()
