# How far a run can be trusted: what must hold whatever the parameters, and the integration against steps twice as fine.
import microvib as mv

motion = mv.simulate(mv.load_scenario("state-1").with_({"record.duration": "8 s"}))
table = mv.find_lines(motion)

print(
    f"two forms of the torque differ by {motion.invariants.torque_forms:.0e}, momentum by {motion.invariants.momentum:.0e}"
)
print(f"energy is balanced to {motion.invariants.energy:.0e}")
print(mv.accuracy(motion, table))
