# More microsteps: driving lines move up and shrink, full-step lines do not care.
import microvib as mv

scenario = mv.load_scenario("state-1")
print("microsteps   drive_1 Hz   drive_1 mN m   full_step_1 mN m")
for microsteps in (8, 16, 32, 64):
    table = mv.find_lines(scenario.with_({"driver.microsteps": microsteps}), start="steady")
    line = table["drive_1"]
    print(
        f"{microsteps:10d} {line.frequency:12.3f} {1e3 * line.amplitude:14.3f}"
        f" {1e3 * table['full_step_1'].amplitude:18.3f}"
    )
