"""Campaigns: many runs of one scenario, from a study file to distributions of its lines."""
