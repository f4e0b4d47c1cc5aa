"""The environments of robots among people that walk by laws of their own."""

from typing import Any

from wayfield.envs.scenarios.splits import members
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.tasks.sheets import sheet_like, signature_like
from wayfield.envs.tasks.specs import CROWDS
from wayfield.envs.team_worlds import Teams
from wayfield.envs.teams import DiffDriveTeam, OmniTeam, TeamVectorEnv

ALL = "people"  # the name of all families


class AmongPeople(Teams):
    """The task of one robot, or several, among people."""

    belongs_to = CROWDS["people"]

    def bank(self, scenario: Any, hull_radius: float) -> tuple[TeamScenario, ...]:
        """Returns the scenarios of a name, or those given; "people/train" are those of all families: see `Teams.bank`.

        Raises:
            ValueError: as `Teams.bank`.
        """
        family, slash, split = scenario.partition("/") if isinstance(scenario, str) else ("", "", "")
        if family == ALL and slash:
            named = super().bank
            scenario = [
                each for name in members(self.belongs_to.name) for each in named(f"{name}/{split}", hull_radius)
            ]
        return super().bank(scenario, hull_radius)


class OmniPeople(OmniTeam):
    __doc__ = sheet_like(
        OmniTeam,
        "An omni robot reaches a goal among people.",
        {
            "Description": """
                One robot reaches a goal among people, who walk by laws of their own inside the compiled step: ORCA,
                social forces by five names, at a constant velocity, or not at all. They see the robot or not
                (`visible`), walk in groups, or react to it: `wayfield.envs.crowds.people`.
                Everything else is as in a team, which this is one of.
            """
        },
        {"scenario": '"crowdnav_5" | a family ("lanes_24/test"), all ("people/test"), or `TeamScenario`s'},
    )

    asks = AmongPeople
    __signature__ = signature_like(OmniTeam, scenario="crowdnav_5")

    def __init__(self, scenario: Any = "crowdnav_5", *options: Any, **named: Any) -> None:
        super().__init__(scenario, *options, **named)


class OmniPeopleVector(TeamVectorEnv):
    """Many `OmniPeople` worlds stepped by one compiled call; the same keyword arguments."""

    def __init__(self, num_envs: int = 1, **kwargs: Any) -> None:
        super().__init__(OmniPeople, num_envs, **kwargs)


class DiffDrivePeople(OmniPeople):
    __doc__ = sheet_like(
        DiffDriveTeam,
        "A differential drive reaches a goal among people.",
        {
            "Description": """
                One robot reaches a goal among people, who walk by laws of their own inside the compiled step: ORCA,
                social forces by five names, at a constant velocity, or not at all. They see the robot or not
                (`visible`), walk in groups, or react to it: `wayfield.envs.crowds.people`.
                Everything else is as in a team, which this is one of.
            """
        },
        {"scenario": '"crowdnav_5" | a family ("lanes_24/test"), all ("people/test"), or `TeamScenario`s'},
    )

    robots = DiffDriveTeam.robots


class DiffDrivePeopleVector(TeamVectorEnv):
    """Many `DiffDrivePeople` worlds stepped by one compiled call; the same keyword arguments."""

    def __init__(self, num_envs: int = 1, **kwargs: Any) -> None:
        super().__init__(DiffDrivePeople, num_envs, **kwargs)
