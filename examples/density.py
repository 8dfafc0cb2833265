# Power spectral density of the disturbance torque, and its RMS in bands.
import microvib as mv

motion = mv.simulate(mv.load_scenario("state-1").with_({"record.duration": "8 s"}))
density = mv.psd(motion, resolution="0.5 Hz")

for low, high in (("0.5 Hz", "5 Hz"), ("40 Hz", "70 Hz"), ("0.5 Hz", "1 kHz")):
    print(f"{low:>6s} to {high:5s} {1e3 * density.band_rms(low, high):8.3f} mN m RMS")
figure = mv.plot(density)
figure.savefig("density.png")
