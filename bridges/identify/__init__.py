"""From a log of a robot to its data sheet: delay, gain, limits, accelerations and lag of its base, with intervals."""
