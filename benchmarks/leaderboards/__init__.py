"""Who did better: entries, verdicts, tables."""
