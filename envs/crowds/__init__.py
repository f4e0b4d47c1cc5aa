"""Worlds of several bodies: neighbours, half-planes of velocities, and how people walk."""
