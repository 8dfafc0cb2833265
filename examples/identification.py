# A parameter from measured lines: the stiffness that the test's reducer had, with its interval.
import numpy as np

import microvib as mv

model = mv.load_scenario("state-1").with_({"record.settle": "4 s", "record.duration": "6 s"})
built = mv.simulate(model.with_si({"reducer.stiffness": 1.05 * model["reducer.stiffness"]}))
noise = np.random.default_rng(1).normal(0.0, 2e-3, built.time.size)
test = mv.Recording({"Mz": built["T_d"] + noise}, built.sample_rate, {"Mz": "N*m"}, "bench, run 7")

fit = mv.identify(model, [test], ["reducer.stiffness"], starts=4, finishes=1)
(stiffness,) = fit.estimates
print(f"{stiffness.estimate:.0f} ± {stiffness.standard_error:.0f} N m/rad, {stiffness.verdict}")
print(
    f"built with {1.05 * model['reducer.stiffness']:.0f}, begun with {model['reducer.stiffness']:.0f}; explained: {fit.usable}"
)
figure = mv.plot(fit)
figure.savefig("identification.png")
