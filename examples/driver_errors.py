# A driver with errors: which lines its gain, offsets and quadrature make, and what a table of currents does against detent torque.
import microvib as mv

scenario = mv.load_scenario("state-1")
errors = {"gain_b": 0.012, "offset_a": 0.006, "offset_b": -0.004, "quadrature": "0.9 deg"}
shift = scenario.motor.detent_torque / (scenario.motor.torque_constant * scenario.motor.current)
drives = {
    "ideal driver": scenario,
    "with errors": scenario.with_({"driver.imperfections": errors}),
    "with a table": scenario.with_({"driver.table": {"harmonics": [{"order": 4, "amplitude": f"{shift} rad"}]}}),
}
names = ("electrical_1", "electrical_2", "full_step_1", "drive_1")
print("0-to-peak, mN m".ljust(16) + "".join(f"{name:>14s}" for name in names))
for title, drive in drives.items():
    lines = {line.name: line for line in mv.find_lines(drive, start="steady")}
    print(title.ljust(16) + "".join(f"{1e3 * lines[name].amplitude:14.4f}" for name in names))
    if title == "with errors":
        told = lines
print("\n".join(f"{name}: {told[name].origin}" for name in names[:2]))
