"""Agents that were trained: what they see, what they add to a controller, their files, and how they drive."""
