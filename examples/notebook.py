"""The five lines of a notebook, and a look at what they give.

python examples/notebook.py
"""

import microvib as mv

scenario = mv.load_scenario("state-1").with_({"tracking.clock_ratio": 0.994, "reducer.stiffness": "9000 N*m/rad"})
motion = mv.simulate(scenario)
table = mv.lines(motion)
spectrum = mv.spectrum(motion, window="hann")
figure = mv.plot(motion)

print(table.text(notable=True))
print(spectrum)
figure.savefig("notebook.png")
