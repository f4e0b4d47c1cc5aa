"""The cases of the three documents: courses, gains and places, what they print, and solutions of their equations."""

import math
from typing import Any

import pytest

from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.records.cases import Case

PATH, FIELD = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"
DEGREE = math.pi / 180.0
RMS, MOST = "cross_track_rms_time", "cross_track_max"
# document A: course, scenario, what the documented gain comes to there, and the retuned one
COURSES: list[tuple[str, str, dict[str, Any], dict[str, Any]]] = [
    ("circle, R 0.5 m", "circle_r0.5", {"steady_offset": -0.1525}, {}),
    ("circle, R 1 m", "circle", {RMS: 0.144, MOST: 0.16, "mean_speed": 0.48, "steady_offset": -0.1469}, {RMS: 0.004}),
    ("circle, R 2 m", "circle_r2", {"steady_offset": -0.104}, {}),
    ("S-curve, 6 m", "s_curve", {RMS: 0.106, MOST: 0.164, "time": 29.7}, {}),
    ("S-curve, 3 m", "s_curve_tight", {RMS: 0.122, MOST: 0.207, "time": 52.0}, {}),
    ("right angles", "right_angle", {RMS: 0.105, MOST: 0.217}, {}),
    ("figure of eight", "figure_eight", {RMS: 0.123, MOST: 0.189, "reference_jumps": 8}, {}),
    ("straight, 12 m", "straight", {}, {}),
]
ARRIVALS = {0.25: (2.6, 4.85, 7.0, 9.25), 0.35: (2.3, 4.25, 6.1, 8.05)}
# document C: time of the corrected field, the means of the real runs, and where the printed field rests
FIELDS: list[tuple[float, dict[str, Any], dict[str, Any]]] = [
    (18.3, {}, {}),
    (11.6, {"final_x_error": 0.2, "final_y_error": 0.112, "final_heading_error": 0.7 * DEGREE},
     {"final_x": 0.0513, "final_y": 0.0256}),
    (11.3, {"final_x_error": 0.058, "final_y_error": 0.152, "final_heading_error": 1.4 * DEGREE}, {}),
]  # fmt: skip
Told = tuple[str, str, str, str, str, dict[str, Any], dict[str, Any], dict[str, Any]]


def wanted() -> list[Told]:
    """Returns document, experiment, id, scenario, policy, gains, figures beside it, and what is not as by default."""
    found: list[Told] = []
    for name, scenario, documented, retuned in COURSES:
        filmed = {"filmed": True} if scenario in ("right_angle", "figure_eight") else {}
        found.append(("A", name, PATH, scenario, "lookahead_documented", {}, documented, filmed))
        found.append(("A", name, PATH, scenario, "lookahead_retuned", {}, retuned, filmed))
        found += [("A", name, PATH, scenario, floor, {}, {}, {}) for floor in ("zero", "random")]
    near: dict[str, Any] = {"arrival_radius": 0.25}
    for lam in (1.0, 0.5):
        told = {"arrival_time_1": {1.0: 2.95, 0.5: 5.95}[lam]}
        assert abs(told["arrival_time_1"] - math.log(20.0) / lam) < 0.05  # e^(-lam t) brings 5 m to 0.25 m
        found.append(("B", "1: to a pose", FIELD, "omni3_goal", "waypoint", {"lam": lam}, told, near))
    found += [("B", "1: to a pose", FIELD, "omni3_goal", floor, {}, {}, near) for floor in ("zero", "random")]
    for radius, length, more in ((0.25, 9.69, {}), (0.35, 9.47, {"arrival_heading_error": 24.0 * DEGREE})):
        told = {f"arrival_time_{k}": time for k, time in enumerate(ARRIVALS[radius], 1)}
        told |= {"arrival_path_length": length} | more
        gains = {"lam": 1.0, "switching_radius": radius}
        how = {"arrival_radius": radius} | ({"filmed": True} if radius == 0.25 else {})
        found.append(("B", "2: waypoints", FIELD, "omni3_waypoints", "waypoint", gains, told, how))
    found += [("B", "2: waypoints", FIELD, "omni3_waypoints", floor, {}, {}, near) for floor in ("zero", "random")]
    pushed = near | {"env_kwargs": {"end_on_success": False, "shove": (8.0, 1.0, -1.0, 0.5)}, "max_episode_steps": 320}
    for policy, gains in (("waypoint", {"lam": 1.0}), ("zero", {}), ("random", {})):
        how = pushed | ({"filmed": True} if gains else {})
        found.append(("B", "station keeping", FIELD, "omni3_goal", policy, gains, {}, how))
    omni = near | {"env_kwargs": {"robot": "omni4"}}
    for k, (corrected, means, rest) in enumerate(FIELDS):
        place = ("C", f"scenario {k}", FIELD, f"apf_{k}")
        found.append((*place, "apf_documented", {"tau": 0.5}, {}, omni))
        found.append((*place, "apf_documented", {"tau": 1.2}, rest, omni))
        gains = {"tau": 0.5, "max_speed": 0.3, "stop_radius": 0.25}
        noisy = near | {"env_kwargs": {"robot": "omni4", "noise": 0.1}, "episodes": 5}
        found.append((*place, "apf_documented", gains, means, noisy))
        for tau in (0.4, 0.6, 0.8):
            told = {"arrival_time_1": (11.0, 16.0)}
            if (k, tau) != (2, 0.8):
                told["centre_distance"] = pytest.approx(tau - 0.02)
            found.append((*place, "apf_escape", {"tau": tau}, told, omni))
        how = omni | ({"filmed": True} if k == 1 else {})
        found.append((*place, "apf_corrected", {}, {"time": corrected}, how))
        found += [(*place, floor, {}, {}, omni) for floor in ("zero", "random")]
    return found


def test_every_case_of_the_documents_is_as_they_print_it() -> None:
    cases = documents()
    assert len(cases) == len(wanted())
    for case, (document, experiment, env_id, scenario, policy, gains, figures, how) in zip(
        cases, wanted(), strict=True
    ):
        assert (case.document, case.experiment, case.env_id) == (document, experiment, env_id)
        assert (case.scenario, case.policy, dict(case.gains)) == (scenario, policy, gains)
        # only document C's means of real runs are printed, in a table a scenario
        printed = case.episodes > 1 and bool(figures)
        assert case.source == (f"Table {case.scenario[-1]}" if printed else "")
        there, other = (case.published, case.reference) if printed else (case.reference, case.published)
        assert not other
        assert set(there) == set(figures)
        for name, figure in figures.items():
            assert there[name] == (figure if isinstance(figure, tuple) else pytest.approx(figure))
        plain = Case(document, experiment, env_id, scenario, policy)
        for name in ("env_kwargs", "max_episode_steps", "episodes", "arrival_radius", "filmed"):
            assert getattr(case, name) == how.get(name, getattr(plain, name)), (name, case.key)
    assert len({case.key for case in cases}) == len(cases)
