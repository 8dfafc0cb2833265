# An amplitude spectrum with the lines named that the physics predicts.
import microvib as mv

motion = mv.simulate(mv.load_scenario("state-1").with_({"record.duration": "8 s"}))
spectrum = mv.spectrum(motion, window="hann")

print(spectrum)
figure = mv.plot(spectrum, mv.find_lines(motion))
figure.savefig("spectrum.png")
