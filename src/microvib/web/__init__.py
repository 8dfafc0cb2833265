"""The page: a local server, and the worker processes that compute for it."""
