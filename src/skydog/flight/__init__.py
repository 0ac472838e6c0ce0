"""From a decision to a motor: pure functions, which the twin flies and the laboratory will.

All are of NumPy: a laboratory calls them a hundred times a second, on one state, and the twin on
a batch of missions, along whatever axes come first.
"""
