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
        "In this setting, SARL's own network (`crowdnav_sarl`) succeeds in 91.0 %, in 11.2 s; it was trained without "
        "lag.",
        "The robot has acceleration limits and a lag. CrowdNav's has none: every 0.25 s it drives any velocity at "
        "once.",
        "The gate looks at ORCA in CrowdNav's own rules, not at (a): `orca_team` is another ORCA, in this setting.",
        "CrowdNav's test.py sets ORCA's safety_space to 0. Its comment says to tune it where people do not see the "
        "robot.",
    ),
    would_change="More seeds of the agent: the interval counts three. SARL's own network in CrowdNav's rules is the "
    "next claim.",
    contest="crowdnav",
    families=("crowdnav",),
    robot="omni3",
    measure="success",
    agent=Side("`people_free`, three seeds", "people_free", "trained", "preset people, 12 M steps a seed"),
    untuned=Side("`orca_team`, default gains", "orca_team", "default"),
    tuned=Side("`orca_team`, searched on CrowdNav's training cases", "orca_team", "tuned", "2.0 M steps of search"),
    training=Training("people", "wayfield/OmniPeople-v0", "people_free_omni3"),
    gate=Gate(0.43, "ORCA in CrowdNav's own rules, driven by a test", 0.426),
    course=Course("crowdnav", PUBLIC_SPLIT, "crowdnav", CLOCK, members=tuple(range(CASES))),
    scenes=CASES,
)
