# Lines of any channel: how unevenly the rotor turns, what the gear carries.
import microvib as mv

motion = mv.simulate(mv.load_scenario("state-1").with_({"record.duration": "8 s"}))
for channel in ("omega_m", "alpha_l", "T_g"):
    table = mv.find_lines(motion, channel)
    print(f"{channel:8s} drive_1 {table['drive_1'].amplitude:.4g} {table.unit}")

try:
    mv.find_lines(motion, "T_x")
except mv.ChannelError as error:
    print(error)
