"""Leaderboards: entries, verdicts, tables."""
