"""Who did it better: cases as data, one rollout loop, metrics of recorded trajectories, and tables and figures of them.

`cases` says what a case is, `documents` and `own_path` list them, `rollout` drives them, `trajectory` is what is kept
of an episode, `metrics` measures it, `results` writes and reads it, `tables`, `figures` and `video` show it, `evaluate`
is the command line, and `throughput` times the environments themselves.
"""
