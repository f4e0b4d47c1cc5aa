"""CrowdNav: learned policies beat ORCA in a crowd that does not see the robot."""

from wayfield.benchmarks.contests import PUBLIC_SPLIT, Course
from wayfield.benchmarks.contests.crowds import CASES, CLOCK
from wayfield.benchmarks.papers.claim import Claim, Gate, Printed, Side, Training

CLAIM = Claim(
    name="crowdnav",
    sentence="A learned policy reaches its goal more often than ORCA among people who do not see the robot.",
    source="Chen, Liu, Kreiss, Alahi: Crowd-Robot Interaction, ICRA 2019, arXiv 1809.08835",
    printed=(
        Printed("ORCA, success, robot unseen", "0.43", "Table I, second-hand"),
        Printed("SARL, success, robot unseen", "0.99", "Table I, second-hand"),
    ),
    setting="CrowdNav's 500 test cases, driven by omni3 with lagged actuators every 0.05 s, at 1 m/s.",
    differs=(
        "The agent is `people_free`, a PPO network that adds to ORCA's twist, not SARL's value network.",
        "SARL's own network (`crowdnav_sarl`) comes to 91.0 % in 11.2 s here, and has never met the lag.",
        "The robot has acceleration limits and a lag; CrowdNav's takes up any velocity every 0.25 s.",
        "In CrowdNav's own rules RVO2 solves 42.6 % here (a test holds it); the gate looks at that number.",
        "Its test.py sets ORCA's safety_space to 0, beside a comment that says to tune it for an unseen robot.",
    ),
    would_change="SARL's own network in CrowdNav's rules; more than three seeds, which the interval counts as three.",
    contest="crowdnav",
    families=("crowdnav",),
    robot="omni3",
    measure="success",
    agent=Side("`people_free`, three seeds", "people_free", "trained", "preset people, 12 M steps a seed"),
    untuned=Side("`orca_team`, default gains", "orca_team", "default"),
    tuned=Side("`orca_team`, searched on CrowdNav's training cases", "orca_team", "tuned", "2.0 M steps of search"),
    training=Training("people", "wayfield/OmniPeople-v0", "people_free_omni3"),
    gate=Gate(0.43, "RVO2 in CrowdNav's own rules, which a test drives", 0.426),
    course=Course("crowdnav", PUBLIC_SPLIT, "crowdnav", CLOCK, members=tuple(range(CASES))),
    scenes=CASES,
)
