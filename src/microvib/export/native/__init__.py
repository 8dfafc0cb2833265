"""The kept LLVM code handed on as it is: a C library, FMUs, a WebAssembly module."""

from microvib.export.native.fmu import export_fmu
from microvib.export.native.library import export_c_library
from microvib.export.native.wasm import export_wasm

__all__ = ["export_c_library", "export_fmu", "export_wasm"]
