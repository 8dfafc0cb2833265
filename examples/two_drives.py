# Two designs over each other: a stiffer reducer in one figure with today's.
import microvib as mv

scenario = mv.load_scenario("state-1").with_({"record.duration": "8 s"})
motions = {
    "as built": mv.simulate(scenario),
    "reducer twice as stiff": mv.simulate(scenario.with_si({"reducer.stiffness": 2.0 * scenario["reducer.stiffness"]})),
}
for name, motion in motions.items():
    print(f"{name:24s} drive_1 {1e3 * mv.find_lines(motion)['drive_1'].amplitude:.2f} mN m")
figure = mv.plot(motions)
figure.savefig("two_drives.png")
