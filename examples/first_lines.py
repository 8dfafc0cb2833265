# The lines of a published drive in its steady state: frequency, amplitude, origin.
import microvib as mv

scenario = mv.load_scenario("state-1")
table = mv.find_lines(scenario, start="steady")

print(repr(table))
print("\nThe largest:", max(table, key=lambda line: line.bin_amplitude_n_m).origin)
