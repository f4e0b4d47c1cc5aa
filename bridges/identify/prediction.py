"""How well data sheets predict what a base did: the one that was found, one of other parts of the drive, and others."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from wayfield.bridges.identify.checks import NAMES, UNITS
from wayfield.bridges.identify.estimate import Fit, commanded, refitted
from wayfield.bridges.identify.response import Drive, Floats, held
from wayfield.bridges.identify.sheet import predicted, sheet_of
from wayfield.envs.robots import Robot

BLOCK = 10.0  # s, of each of which a part is held out
LEAST = 100  # samples of each part of a split drive
WORSE = 1.1  # times the error of an ideal base, from which on a sheet is none


@dataclasses.dataclass(frozen=True)
class Prediction:
    """RMS (2,) of speeds, m/s and rad/s, over the parts of a drive that the fit of `unseen` has not seen."""

    sheet: Floats  # of the sheet that is written
    unseen: Floats  # of one that is fitted to the other parts
    base: Floats  # of the base's own sheet
    ideal: Floats  # of a base that does at once what it is told

    def rows(self, name: str) -> dict[str, Floats]:
        """Returns the errors by what is compared; `name` is the base's."""
        return {
            "held out": self.unseen, "this sheet": self.sheet, f"{name}'s sheet": self.base, "an ideal base": self.ideal
        }  # fmt: skip

    def doubts(self, name: str, drive: Drive) -> list[str]:
        """Returns a line where the base's own sheet predicts better than one that is fitted to the other parts."""
        axes = list(commanded(drive))
        better = [axis for axis in axes if self.base[axis] < self.unseen[axis]]
        errors = ", ".join(
            f"{NAMES[axis]} {self.base[axis]:.3g} against {self.unseen[axis]:.3g} {UNITS[axis]}" for axis in better
        )
        keep = np.log(self.base[axes] / self.unseen[axes]).sum() < 0.0
        told = f"{name}'s sheet predicts held-out time better ({errors})"
        return [f"{told}: keep that sheet" if keep else told] if better else []

    def check(self, drive: Drive) -> None:
        """Raises ValueError, in one line, where a sheet errs by more than an ideal base."""
        for axis in commanded(drive):
            most = WORSE * self.ideal[axis]
            for what, error in (("the sheet", self.sheet[axis]), ("a sheet of a part of the log", self.unseen[axis])):
                if error > most:
                    raise ValueError(
                        f"{what} predicts the {NAMES[axis]} worse than an ideal base (RMS {error:.3g} against "
                        f"{self.ideal[axis]:.3g} {UNITS[axis]} on held-out time), so none is written: are "
                        "these the commands that the base follows? Record again without gaps, or for longer"
                    )


def predict(robot: Robot, base: Robot, written: Fit, fixed: Mapping[int, float], share: float) -> Prediction | None:
    """Returns how well sheets predict parts of a drive; None where it is too short to be split.

    Args:
        robot: of the sheet that is written.
        base: the robot that it was made from.
        written: the fit that it holds.
        fixed: the values in it, by their place in PAIR, that are not fitted.
        share: of each BLOCK of the drive that a second fit sees; the rest is held out.
    """
    drive = written.drive
    seen = (drive.times - drive.times[0]) % BLOCK < share * BLOCK
    late = ~seen & drive.counted & ~written.wrong
    if min((drive.counted & seen).sum(), late.sum()) < LEAST:
        return None
    unseen = sheet_of(base, written, refitted(written, drive.only(seen), fixed))
    commands = np.stack([held(drive.command_times, drive.commands[:, axis], drive.times) for axis in range(2)])
    ideal = np.clip(commands, drive.reported[0][:, None], drive.reported[1][:, None])
    responses = *(predicted(each, drive) for each in (robot, unseen, base)), ideal
    return Prediction(*(np.sqrt(((drive.speeds.T - each)[:, late] ** 2).mean(axis=1)) for each in responses))
