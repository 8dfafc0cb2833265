"""From LLVM's code to an object file for this very processor; as a program, from standard input to
standard output.

It imports LLVM and nothing of this package, so that a process that is started for it (``ahead``) is
at work in a twentieth of a second. What follows its name on the command line is where it imports
from.
"""

from __future__ import annotations

import lzma
import sys

if __name__ == "__main__":
    sys.path[:] = sys.argv[1:]

import llvmlite.binding as llvm

llvm.initialize_native_target()
llvm.initialize_native_asmprinter()


def host() -> tuple[str, str, str]:
    """This machine's kind, its processor, and what that can do."""
    try:
        features = str(llvm.get_host_cpu_features().flatten())
    except RuntimeError:  # LLVM does not know
        features = ""
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), features


def object_file(content: bytes, triple: str, cpu: str, features: str) -> bytes:
    """Machine code of LLVM's bitcode, which may be compressed."""
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=cpu, features=features, opt=3, reloc="default", codemodel="jitdefault", jit=True
    )
    module = llvm.parse_bitcode(content if content.startswith(b"BC") else lzma.decompress(content))
    module.triple, module.data_layout = triple, str(machine.target_data)
    module.verify()
    return bytes(machine.emit_object(module))


if __name__ == "__main__":
    sys.stdout.buffer.write(object_file(sys.stdin.buffer.read(), *host()))
