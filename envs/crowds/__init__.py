"""Worlds of several bodies: who is near whom, half-planes of velocities, and how people walk."""
