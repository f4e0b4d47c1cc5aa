"""What `--set` can change: every key of a preset with its default, its range and what it is."""

from typing import Any, NamedTuple

from wayfield.policies.training.presets import Preset, settable


class Setting(NamedTuple):
    """What a key takes, and what it is."""

    range: str
    what: str


ABOUT: dict[str, Setting] = {
    "robot": Setting("name, none", "of the environment; none: its default"),
    "steps": Setting("1 to 1e12", "frames of the run; at least num_envs x horizon"),
    "num_envs": Setting("1 to 65536", "robots side by side; at least one for each world and pace"),
    "horizon": Setting("1 to 65536", "control periods between updates"),
    "batch_size": Setting("2 to 4194304", "frames of a gradient step"),
    "epochs": Setting("1 to 100000", "passes over the frames of an update"),
    "hidden": Setting("a,b,... 1 to 16384", "units of the hidden layers"),
    "activation": Setting("tanh, relu", "between the layers"),
    "learning_rate": Setting("> 0", "at the start"),
    "final_learning_rate": Setting(">= 0", "at the end"),
    "clip": Setting("> 0", "of PPO's ratio, at the start"),
    "final_clip": Setting(">= 0", "at the end"),
    "discount": Setting("0 to 1, open", "gamma"),
    "gae_lambda": Setting("0 to 1, open", "of the advantage estimate"),
    "entropy": Setting(">= 0", "weight of the entropy bonus"),
    "log_std": Setting("any number", "of the actions, at the start"),
    "target_kl": Setting("> 0", "beyond which an update stops early"),
    "max_grad_norm": Setting("> 0", "to which gradients are clipped"),
    "paces": Setting("a,b,... > 0", "m/s, the speeds asked for, of as many robots each"),
    "speed": Setting("> 0", "m/s, of validation, and of the agent"),
    "validations": Setting("1 to 100000", "in a run"),
    "paced": Setting(
        "true, false", "whether its mean speeds are measured, so that an agent holds the asked one on a path"
    ),
    "controller": Setting("policy, empty", "that teaches the network, or that it adds to"),
    "controller_gains": Setting(
        "default, tuned, shipped", "of the controller; shipped: what agents there were taught with"
    ),
    "imitation": Setting("0 to steps", "frames in which the network is taught before PPO"),
    "imitation_rate": Setting(">= 0", "learning rate of the teaching"),
    "lessons": Setting("0 to 16777216", "that the teaching keeps and learns from again; 0: only the latest"),
    "reach": Setting(">= 0", "share of its twists that the network adds; 0: it drives alone"),
    "arriving": Setting("true, false", "the law that ends the way does so in training too"),
    "shortest_ways": Setting("true, false", "progress is measured along the shortest way"),
    "patience": Setting("0 to 100000", "validations without a better one that end a run; 0: none do"),
    "time_limit": Setting("1 to 1000000", "control periods of an episode"),
    "sac.buffer_size": Setting("1 to 67108864", "frames, the latest, that gradient steps draw from"),
    "sac.learning_starts": Setting("0 to 1e12", "frames driven at random before the first gradient step"),
    "sac.gradient_steps": Setting("1 to 65536", "an update, which is horizon control periods of all robots"),
    "sac.target_rate": Setting("> 0 to 1", "tau, of the targets of the critics"),
    "features.num_preview": Setting("0 to 1000", "points of the path ahead that are seen"),
    "features.error_scale": Setting("> 0", "m, up to which the error is seen in proportion"),
    "features.preview_scale": Setting("> 0", "m, of the points ahead"),
    "features.turn_scale": Setting("> 0", "rad, up to which turns are seen in proportion"),
    "features.speed_scale": Setting("> 0", "m/s"),
    "features.yaw_scale": Setting("> 0", "rad/s"),
    "features.previous": Setting("0 to 1000", "own actions seen"),
    "features.trails": Setting("a,b,... > 0", "s, of the points that trail behind"),
    "features.frames": Setting("1 to 1000", "observations seen"),
    "features.stride": Setting("1 to 1000", "control periods between them"),
    "features.limits": Setting("true, false", "whether the base's accelerations and lag are seen"),
    "features.num_beams": Setting("1 to 10000", "of the scan, all around; the environment's too"),
    "features.hull_radius": Setting(">= 0", "m, of the disc that the ways ahead are measured for"),
    "features.max_range": Setting("> 0", "m, of the scan; the environment's too"),
    "features.range_scale": Setting("> 0", "m, at which nearness is one half"),
    "features.margin": Setting(">= 0", "m, added to the disc"),
    "features.distance_scale": Setting("> 0", "m, up to which the goal's is seen in proportion"),
    "features.pool": Setting("1 to 10000", "beams a direction; divides num_beams"),
    "features.frame": Setting("goal, body", "in which the scan and the action are meant"),
    "features.crumbs": Setting("0 to 1000", "places remembered; 0: none"),
    "features.crumb_gap": Setting("> 0", "m, between them"),
    "features.gap": Setting(">= 0", "m, that the guard keeps"),
    "features.braking": Setting(">= 0", "m/s^2, of the guard; 0: nothing is guarded"),
    "features.reaction": Setting(">= 0", "s, of the guard"),
    "features.moving": Setting("true, false", "whether what comes nearer by itself is seen"),
    "features.arrival": Setting(">= 0", "m, from which a law ends the way to the goal; 0: the network does"),
    "features.fine": Setting("> 0", "m, up to which the place of a dock is seen in proportion"),
    "features.fine_turn": Setting("> 0", "rad, up to which the turn to its heading is"),
    "features.rest": Setting("> 0", "m, of a dock, within which the robot is told to stand"),
    "features.rest_turn": Setting("> 0", "rad, of its heading, within which it is"),
    "actions.kind": Setting("unicycle, planar", "what the two outputs mean"),
    "actions.yaw_rate": Setting("> 0", "rad/s, of a full turn"),
    "actions.reverse": Setting("0 to 1", "share of the speed that it may drive backwards"),
    "reward.error_cost": Setting("any number", "1/m, of progress that is driven beside the path"),
    "reward.error_rate": Setting("any number", "1/m, of being beside it"),
    "reward.leniency": Setting("any number", "share of the strictness that a run begins with"),
    "reward.jerk_cost": Setting("any number", "of changes of the action, squared"),
    "reward.chatter_cost": Setting("any number", "of changes of those changes, squared"),
    "reward.stall_cost": Setting("any number", "of standing still, at the start"),
    "reward.final_stall_cost": Setting("any number", "at the end"),
    "reward.stall_share": Setting("> 0", "of the asked speed, under which a robot stalls"),
    "reward.failure": Setting("any number", "of leaving the corridor"),
    "reward.time_cost": Setting("any number", "of a step"),
    "reward.near_cost": Setting("any number", "of being near an obstacle"),
    "reward.near": Setting("> 0", "m, what is near"),
    "reward.success": Setting("any number", "of arriving"),
    "reward.collision": Setting("any number", "of touching"),
}


def rows(preset: Preset) -> list[tuple[str, str, str, str]]:
    """Returns key, default, range and meaning of all that `--set` can change of a preset, in its order."""
    return [(key, _text(value), *ABOUT[key]) for key, value in settable(preset)]


def _text(value: Any) -> str:
    """Returns a value as `--set` takes it."""
    if isinstance(value, tuple):
        return ",".join(map(_text, value)) or "empty"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return str(value) or "empty"
