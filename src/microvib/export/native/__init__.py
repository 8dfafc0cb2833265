"""The kept LLVM code handed on as it is: a C library, FMUs, a WebAssembly module."""
