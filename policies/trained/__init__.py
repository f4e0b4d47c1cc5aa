"""Policies of the agents that ship, alone or with a law."""
