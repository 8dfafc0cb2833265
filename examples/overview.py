# One look at a run: time history, a few microsteps, spectrum with named lines, array mode.
import microvib as mv

scenario = mv.load_scenario("state-1").with_({"record.duration": "8 s"})
motion = mv.simulate(scenario)

print(motion)
figure = mv.plot(motion)
figure.savefig("overview.png")
