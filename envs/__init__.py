"""The environments. Importing this registers their ids; the code behind an id is loaded when it is made."""

import gymnasium

from wayfield.envs.tasks.specs import CROWDS, EVERY

_EPISODE_STEPS = 1200  # control periods: 60 s

for _spec in EVERY.values():
    for _id in _spec.ids.values():
        gymnasium.register(
            id=_id,
            entry_point=_spec.entry_point(_id),
            vector_entry_point=f"{_spec.entry_point(_id)}Vector",
            max_episode_steps=_spec.clock if _spec in CROWDS.values() else _EPISODE_STEPS,
        )
