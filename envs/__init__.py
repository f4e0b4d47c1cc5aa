"""The environments. Importing this registers their ids; the code behind an id is loaded when it is made."""

import gymnasium

# A Pioneer P3DX follows a path (document A): 60 s of control periods.
gymnasium.register(
    id="wayfield/DiffDrivePathFollowing-v0",
    entry_point="wayfield.envs.path_following:DiffDrivePathFollowing",
    vector_entry_point="wayfield.envs.path_following:DiffDrivePathFollowingVector",
    max_episode_steps=1200,
)

# An omni robot with three or four wheels drives to a goal pose, or through waypoints, among obstacles (B and C).
gymnasium.register(
    id="wayfield/OmniGoalObstacles-v0",
    entry_point="wayfield.envs.goal_reaching:OmniGoalObstacles",
    vector_entry_point="wayfield.envs.goal_reaching:OmniGoalObstaclesVector",
    max_episode_steps=1200,
)

# Task and robot are orthogonal: an omni robot follows a path ...
gymnasium.register(
    id="wayfield/OmniPathFollowing-v0",
    entry_point="wayfield.envs.path_following:OmniPathFollowing",
    vector_entry_point="wayfield.envs.path_following:OmniPathFollowingVector",
    max_episode_steps=1200,
)

# ... and a Pioneer P3DX drives to a goal among obstacles.
gymnasium.register(
    id="wayfield/DiffDriveGoalObstacles-v0",
    entry_point="wayfield.envs.goal_reaching:DiffDriveGoalObstacles",
    vector_entry_point="wayfield.envs.goal_reaching:DiffDriveGoalObstaclesVector",
    max_episode_steps=1200,
)

# An omni robot comes to rest at a pose: in the open, at a wall, between boxes, past a disc that moves ...
gymnasium.register(
    id="wayfield/OmniDocking-v0",
    entry_point="wayfield.envs.docking:OmniDocking",
    vector_entry_point="wayfield.envs.docking:OmniDockingVector",
    max_episode_steps=1200,
)

# ... and a Pioneer P3DX does, forward or backward.
gymnasium.register(
    id="wayfield/DiffDriveDocking-v0",
    entry_point="wayfield.envs.docking:DiffDriveDocking",
    vector_entry_point="wayfield.envs.docking:DiffDriveDockingVector",
    max_episode_steps=1200,
)
