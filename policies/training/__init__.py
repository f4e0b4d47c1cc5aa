"""Training of agents with stable-baselines3's PPO on native vector environments; `train.py` is its command line.

`presets` (what is trained, and how), `shaping` (features, rewards and speeds on top of the robots of `envs/sb3.py`),
`ways` (what is left of the shortest way to a goal), `learner` (PPO, its state as plain arrays), `checkpoints`,
`validation`, `run` (one run), `seeds` (many side by side), `curves` (their figure),
`recorded` and `offline` (sets of episodes, and what learns from them).
"""
