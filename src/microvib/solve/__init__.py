"""From a scenario to its motion: one compiled kernel, and what prepares and collects its work."""
