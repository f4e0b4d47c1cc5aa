"""The commands of `wayfield`, but for training."""
