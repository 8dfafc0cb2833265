"""The library from Python, by ctypes alone: python example.py ./drive-linux64.so"""

import ctypes
import sys

library = ctypes.CDLL(sys.argv[1])
library.microvib_new.restype = ctypes.c_void_p
library.microvib_output.restype = ctypes.c_double
library.microvib_error.restype = ctypes.c_char_p

why = ctypes.create_string_buffer(256)
drive = ctypes.c_void_p(library.microvib_new(why, ctypes.c_size_t(256)))
if not drive:
    sys.exit(why.value.decode())
torque = library.microvib_find_output(drive, b"T_d")
print("time_s,t_d_n_m")
for k in range(1, 201):
    if library.microvib_do_step(drive, ctypes.c_double(0.01 * k)):
        sys.exit(library.microvib_error(drive).decode())
    print(f"{0.01 * k:.17g},{library.microvib_output(drive, ctypes.c_size_t(torque)):.17g}")
library.microvib_free(drive)
