"""The periodic steady state at constant rate, found directly."""
