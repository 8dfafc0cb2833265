# The start from rest over time: the array's mode rings at 1.2 Hz and dies away, full-step lines stay.
import microvib as mv

scenario = mv.load_scenario("state-1").with_({"record.settle": "0 s", "record.duration": "60 s"})
motion = mv.simulate(scenario, channels="T_d")
waterfall = mv.waterfall(motion, resolution="0.25 Hz")

print(waterfall)
figure = mv.plot(waterfall, highest="8 Hz")
figure.savefig("waterfall.png")
