"""The C library of a drive, called by ctypes."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

_ONE = {
    "microvib_do_step": (ctypes.c_int, ctypes.c_double),
    "microvib_begin_record": (ctypes.c_int, ctypes.c_double, ctypes.c_double),
    "microvib_record": (ctypes.c_int, ctypes.c_size_t, ctypes.c_void_p),
    "microvib_columns": (ctypes.c_size_t,),
    "microvib_channel_name": (ctypes.c_char_p, ctypes.c_size_t),
    "microvib_error": (ctypes.c_char_p,),
    "microvib_outputs": (ctypes.c_size_t,),
    "microvib_output": (ctypes.c_double, ctypes.c_size_t),
    "microvib_output_name": (ctypes.c_char_p, ctypes.c_size_t),
    "microvib_output_unit": (ctypes.c_char_p, ctypes.c_size_t),
    "microvib_find_output": (ctypes.c_int, ctypes.c_char_p),
    "microvib_state_bytes": (ctypes.c_size_t,),
    "microvib_get_state": (None, ctypes.c_void_p),
    "microvib_set_state": (ctypes.c_int, ctypes.c_void_p),
    "microvib_set_rate": (ctypes.c_int, ctypes.c_double),
    "microvib_set_microsteps": (ctypes.c_int, ctypes.c_int64),
    "microvib_microsteps": (ctypes.c_int64,),
    "microvib_set_hub_acceleration": (ctypes.c_int, ctypes.c_double),
    "microvib_set_independent": (ctypes.c_int, ctypes.c_int),
    "microvib_set_interface_acceleration": (ctypes.c_int, ctypes.c_int, ctypes.c_double),
    "microvib_set_shaft_torque": (ctypes.c_int, ctypes.c_double),
    "microvib_time": (ctypes.c_double,),
    "microvib_parameters": (ctypes.c_size_t,),
    "microvib_parameter_name": (ctypes.c_char_p, ctypes.c_size_t),
    "microvib_parameter": (ctypes.c_double, ctypes.c_size_t),
    "microvib_set_parameter": (ctypes.c_int, ctypes.c_size_t, ctypes.c_double),
    "microvib_free": (None,),
}
"""Functions of one drive: the type of the result, those of the further arguments."""


def load(path: Path, mode: int = ctypes.DEFAULT_MODE) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path), mode)
    for name, (result, *arguments) in _ONE.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, [ctypes.c_void_p, *arguments]
    library.microvib_new.restype = ctypes.c_void_p
    library.microvib_new.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
    library.microvib_memory.restype = ctypes.c_size_t
    library.microvib_memory.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
    library.microvib_open.restype = ctypes.c_void_p
    library.microvib_open.argtypes = [
        ctypes.c_char_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t,
    ]  # fmt: skip
    return library


class Drive:
    """One instance; a failure is raised as its sentence."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.library = library
        why = ctypes.create_string_buffer(256)
        self.at = library.microvib_new(why, 256)
        if not self.at:
            raise RuntimeError(why.value.decode())

    def call(self, name: str, *arguments):
        return getattr(self.library, f"microvib_{name}")(self.at, *arguments)

    def ask(self, name: str, *arguments) -> None:
        if self.call(name, *arguments):
            raise RuntimeError(self.call("error").decode())

    def step(self, stop: float) -> None:
        self.ask("do_step", stop)

    def __getitem__(self, name: str) -> float:
        which = self.call("find_output", name.encode())
        assert which >= 0, name
        return self.call("output", which)

    @property
    def names(self) -> list[str]:
        return [self.call("output_name", k).decode() for k in range(self.call("outputs"))]

    def set_parameter(self, name: str, value: float) -> None:
        names = [self.call("parameter_name", k).decode() for k in range(self.call("parameters"))]
        self.ask("set_parameter", names.index(name), value)

    def record(self, count: int) -> np.ndarray:
        rows = np.full((count, self.call("columns")), np.nan)
        self.ask("record", count, rows.ctypes.data)
        return rows

    @property
    def state(self) -> bytes:
        room = ctypes.create_string_buffer(self.call("state_bytes"))
        self.call("get_state", room)
        return room.raw

    @state.setter
    def state(self, content: bytes) -> None:
        self.ask("set_state", content)

    def free(self) -> None:
        self.call("free")
