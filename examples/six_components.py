# Forces and cross moments on the spacecraft, of an array whose modes are known in six components.
import microvib as mv

scenario = mv.load_scenario("state-1")
about_axis = scenario.array.H[0]  # participation about the drive axis, z
participation = [0.4, 3.0, 0.0, 1.2, 0.0, about_axis]
motion = mv.simulate(scenario.with_({"array.modes.0.interface_participation": participation, "record.duration": "8 s"}))

for component in ("Fx", "Fy", "Mx", "Mz"):
    table = mv.find_lines(motion, component)
    largest = max((line for line in table if line.status == "ok"), key=lambda line: line.amplitude)
    print(f"{component}: {largest.name} is largest, {largest.amplitude:.3g} {table.unit} at {largest.frequency:.4g} Hz")
figure = mv.plot(mv.spectrum(motion, "Fy", window="hann"))
figure.savefig("six_components.png")
