# Lines in a recording: with a scenario they get their names and the clock is found, without one they are found all the same.
import numpy as np

import microvib as mv

scenario = mv.load_scenario("state-1")
motion = mv.simulate(scenario.with_({"tracking.clock_ratio": 0.9965}))
noise = np.random.default_rng(1).normal(0.0, 5e-3, motion.time.size)
recording = mv.Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"}, "bench, run 7")

named, unnamed = mv.find_lines(recording, scenario=scenario), mv.find_lines(recording)
print(f"clock {named.clock_ratio:.6f} ± {named.clock_ratio_uncertainty:.6f} of the scenario's")
line = named["drive_1"]
print(f"drive_1 {1e3 * line.amplitude:.2f} ± {1e3 * line.amplitude_uncertainty:.2f} mN m at {line.frequency:.4f} Hz")
print(f"{len(unnamed)} lines stand out without a drive; the first at {unnamed.lines[0].frequency:.4f} Hz")
