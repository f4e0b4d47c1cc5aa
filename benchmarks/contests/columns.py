"""Columns that tables of several contests have."""

from wayfield.benchmarks.contests.contest import COST, Column

COLLISION = Column("collision (%)", "collision", 1, 100.0)
TIMEOUT = Column("timeout (%)", "timeout", 1, 100.0)
SPL = Column("SPL", "spl", 3, with_interval=True)
SCT = Column("SCT", "sct", 3, with_interval=True)
IMPUTED = Column("imputed (s)", COST, 1, with_interval=True)
TIME = Column("time of successes (s)", "time", 1, successes_only=True)
LDLJ = Column("LDLJ", "ldlj", 2)
EFFORT = Column("effort (rad²/s)", "effort", 0, successes_only=True)
FAULTS = Column("faults", "faults", 2)
