"""Test data: recordings, what is done to them before they are analysed, and a virtual bench that
makes them.
"""
