"""Ten blows of a hammer on the virtual table, 0.2 m off its axis, as a recording: one of them a double hit."""

import math

import numpy as np

from microvib.io.recordings import write_recording
from microvib.io.scenario_file import load_bench
from microvib.model.rigid import COMPONENTS
from microvib.testdata.bench import measure
from microvib.testdata.recording import Recording

ARM, BLOWS, PULSE = 0.2, 10, 2e-4  # m, count, seconds

bench = load_bench("bench.yaml").model_copy(update={"duration": BLOWS + 1.0, "lead": 0.5})
n = math.ceil(bench.span * bench.analog_rate)
t = np.arange(n) / bench.analog_rate - bench.lead
rng = np.random.default_rng(1)
force = np.zeros(n)
for k in range(BLOWS):
    at = 0.5 + k + rng.uniform(0.0, 0.05)
    force += rng.uniform(20.0, 60.0) * np.exp(-0.5 * ((t - at) / PULSE) ** 2)
    if k == 6:
        force += 15.0 * np.exp(-0.5 * ((t - at - 0.03) / PULSE) ** 2)
loads = np.zeros((6, n))
loads[COMPONENTS.index("Mz")] = ARM * force
loads[COMPONENTS.index("Fx")] = force  # where the table is stiff: the hammer's own channel, by the same filter
read = measure(bench, loads, np.zeros(n), seed=99)
channels = {"hammer": read["Fx"], "Mz": read["Mz"]}
hits = Recording(channels, bench.sample_rate, {"hammer": "N", "Mz": "N*m"}, "blows about z")
write_recording(hits, "hits.uff")
