# The lines of a published drive in its steady state: frequency, amplitude, origin.
import microvib as mv

table = mv.find_lines("state-1", start="steady")

print(repr(table))
print("\nThe largest:", max(table, key=lambda line: line.bin_amplitude).origin)
