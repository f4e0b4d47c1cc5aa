"""Means, intervals and paired differences of episodes."""
