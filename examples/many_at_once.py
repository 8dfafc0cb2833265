# Scatter of units: many drives at once, each torque the same to the last bit as alone.
import numpy as np

import microvib as mv

scenario = mv.load_scenario("state-1").with_({"record.settle": "6 s", "record.duration": "4 s"})
random = np.random.default_rng(1)
stiffness = scenario["reducer.stiffness"] * random.normal(1.0, 0.1, 16)
motions = mv.simulate_many([scenario.with_si({"reducer.stiffness": float(one)}) for one in stiffness])

amplitudes = np.array([1e3 * mv.find_lines(motion)["drive_1"].amplitude for motion in motions])
print(f"drive_1: {amplitudes.mean():.2f} mN m on average, {amplitudes.min():.2f} to {amplitudes.max():.2f}")
print(
    f"one per cent of stiffness changes it by {np.polyfit(stiffness / stiffness.mean() * 100, amplitudes, 1)[0]:+.3f} mN m"
)
