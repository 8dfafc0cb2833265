# A run kept as a folder, as the command line writes it, and read back whole.
import microvib as mv

scenario = mv.load_scenario("state-1").with_({"record.settle": "4 s", "record.duration": "4 s"})
files = mv.write_run(mv.run_scenario(scenario), "kept", limit=mv.Limit("60 mN*m"))
print(", ".join(files))

kept = mv.read_run("kept")
print(kept.motion)
print(f"drive_1 {1e3 * kept.table['drive_1'].amplitude:.3f} mN m, of microvib {kept.versions['microvib']}")
