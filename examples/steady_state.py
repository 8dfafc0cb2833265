# The steady state is solved for, not waited for: the same lines as after a minute of settling.
import time

import microvib as mv

scenario = mv.load_scenario("state-1").with_({"record.settle": "60 s", "record.duration": "8 s"})
begun = time.perf_counter()
steady = mv.find_lines(scenario, start="steady")
between = time.perf_counter()
settled = mv.find_lines(mv.simulate(scenario, channels="T_d"))
took = time.perf_counter() - between

for name in ("drive_1", "drive_2", "full_step_1"):
    solved, waited = steady[name].amplitude, settled[name].amplitude
    print(f"{name:12s} {1e3 * solved:8.4f} and {1e3 * waited:8.4f} mN m, {100 * (waited / solved - 1):+.3f} %")
print("The steady state took", "less" if between - begun < took else "more", "time than the run.")
