"""Rate profiles of a solar array drive: the shortest that keeps modes from ringing, beside ramps, S
curves and input shapers.

``rate_profile`` has profiles and the ringing that they leave in a linear mode, ``modes`` the modes
with their uncertainty, ``shapes`` the classical shapes, ``shortest`` the linear program,
``manoeuvre`` what a profile is for, ``runs`` the full model, ``plan`` all together.
"""
