# Forces and cross moments on the spacecraft, of an array whose modes are known in six components.
import microvib as mv

scenario = mv.load_scenario("state-1")
H = scenario.array.H[0]  # participation about the drive axis, z
six = scenario.with_({"array.modes.0.interface_participation": [0.4, 3.0, 0.0, 1.2, 0.0, H], "record.duration": "8 s"})
motion = mv.simulate(six)

for component in ("Fx", "Fy", "Mx", "Mz"):
    table = mv.find_lines(motion, component)
    top = max((line for line in table if line.status == "ok"), key=lambda line: line.amplitude_n_m)
    print(
        f"{component}: largest steady line {top.line}, {top.amplitude_n_m:.3g} {table.unit} at {top.frequency_hz:.4g} Hz"
    )
figure = mv.plot(mv.spectrum(motion, "Fy", window="hann"))
figure.savefig("six_components.png")
