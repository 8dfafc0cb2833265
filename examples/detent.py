# Where full-step lines come from: the detent torque makes them and their sidebands, driving lines hardly notice.
import microvib as mv

scenario = mv.load_scenario("state-1")
print("detent torque   full_step_1   drive_1_minus_1   drive_1   [mN m]")
for share in (0.0, 0.5, 1.0):
    changed = scenario.with_si({"motor.detent_torque": share * scenario["motor.detent_torque"]})
    lines = {line.name: 1e3 * line.amplitude for line in mv.find_lines(changed, start="steady")}
    names = ("full_step_1", "drive_1_minus_1", "drive_1")
    print(f"{100 * share:11.0f} %" + "".join(f"{lines.get(name, 0.0):14.4f}" for name in names))
