"""The server: who may ask, what is allowed, connections."""
