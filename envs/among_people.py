"""The environments of robots among people that walk by laws of their own."""

import dataclasses
from typing import Any

from wayfield.envs.scenarios.splits import members
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.tasks.arguments import argument
from wayfield.envs.tasks.sheets import sheet_like
from wayfield.envs.tasks.specs import CROWDS
from wayfield.envs.team_worlds import TeamArguments, Teams
from wayfield.envs.teams import DiffDriveTeam, OmniTeam, TeamVectorEnv
from wayfield.envs.vector import vector_of

ALL = "people"  # the name of all families
_DESCRIPTION = """
    One robot reaches a goal among people, who walk by laws of their own inside the compiled step: ORCA,
    social forces by five names, at a constant velocity, or not at all. They see the robot or not
    (`visible`), walk in groups, or react to it: `wayfield.envs.crowds.people`.
    Everything else is as in a team, which this is one of.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PeopleArguments(TeamArguments):
    """What an environment among people takes."""

    scenario: Any = argument("crowdnav_5", 'a family ("lanes_24/test"), all ("people/test"), or `TeamScenario`s')


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


def _sheet(team: type[OmniTeam], about: str, *, holonomic: bool) -> str:
    return sheet_like(team, about, {"Description": _DESCRIPTION}, arguments=PeopleArguments, holonomic=holonomic)


class OmniPeople(OmniTeam):
    __doc__ = _sheet(OmniTeam, "An omni robot reaches a goal among people.", holonomic=True)

    arguments = PeopleArguments
    asks = AmongPeople


OmniPeopleVector = vector_of(OmniPeople, TeamVectorEnv)


class DiffDrivePeople(OmniPeople):
    __doc__ = _sheet(DiffDriveTeam, "A differential drive reaches a goal among people.", holonomic=False)

    robots = DiffDriveTeam.robots


DiffDrivePeopleVector = vector_of(DiffDrivePeople, TeamVectorEnv)
