# Where the array's modes move when the drive holds it instead of a clamp, and which lines to expect.
import microvib as mv

for mode in mv.coupled_modes("state-1"):
    clamped = f"clamped {mode.fixed_frequency:.4f} Hz" if mode.fixed_frequency else "of the drive itself"
    print(f"{mode.name:18s} {mode.frequency:9.4f} Hz, damping {100 * mode.damping:6.2f} %, {clamped}")
for line in mv.expected_lines("state-1", "60 Hz", harmonics=2):
    print(f"{line.name:18s} {line.frequency:9.4f} Hz  {line.origin}")
