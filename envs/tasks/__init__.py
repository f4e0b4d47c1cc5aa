"""What a task is: its value, observation, briefing, and the one step that all tasks share."""
