# A test against its model: each line's difference over its uncertainty, at the clock that the recording shows.
import numpy as np

import microvib as mv

model = mv.load_scenario("state-1").with_({"record.duration": "8 s"})
built = mv.simulate(
    model.with_si({"reducer.stiffness": 1.05 * model["reducer.stiffness"], "tracking.clock_ratio": 0.9965})
)
noise = np.random.default_rng(1).normal(0.0, 2e-3, built.time.size)
test = mv.Recording({"Mz": built["T_d"] + noise}, built.sample_rate, {"Mz": "N*m"}, "bench, run 7")

found = mv.compare(test, model, names=("", "model"))
for row in (row for row in found.rows if row.line in ("drive_1", "drive_2", "drive_3", "full_step_1")):
    tested, modelled = 1e3 * row.a.amplitude, 1e3 * row.b.amplitude
    print(f"{row.line:12s} {tested:8.3f} {modelled:8.3f} mN m, {row.significance:.1f} sigma: {row.verdict}")
figure = mv.plot(found)
figure.savefig("comparison.png")
