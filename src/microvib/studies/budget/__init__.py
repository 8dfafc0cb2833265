"""Pointing budgets: sources, how they add up, requirements and verdicts."""
