"""One drive: the rollout loop, and the metrics of its trajectory."""
