"""Object files of the kept code, for the processors that it is handed on to."""

from __future__ import annotations

import lzma
from dataclasses import dataclass
from functools import cache

import llvmlite
import llvmlite.binding as llvm
from llvmlite import ir

from microvib.compiled import EditedSourcesError, Unit, machine
from microvib.errors import MicrovibError
from microvib.solve import kernel, propagate, propagators

PREFIX = "microvib_"
FUNCTIONS = {
    kernel.code: ("snapshot", "initial_friction"),
    propagators.code: ("tabulate", "linear_part"),
    propagate.code: ("advance",),
}
"""Entries of each unit that are handed on."""


@dataclass(frozen=True)
class Platform:
    """A system and processor that code is made for."""

    name: str
    """As FMI 2 names its folder, or a word of our own."""
    triple: str
    """As LLVM says it."""
    zig: str
    """As Zig says it."""
    library: str
    """Pattern of a shared library's name."""
    processors: tuple[tuple[str, str], ...] = (("generic", ""),)
    """Processors that code is made for, and what the names of its functions end in; with two the
    wrapper chooses."""
    features: str = ""
    """Further features of its processors, as LLVM says them."""


_X86 = (("x86-64", ""), ("x86-64-v3", "_v3"))
PLATFORMS = {
    platform.name: platform
    for platform in (
        Platform("linux64", "x86_64-unknown-linux-gnu", "x86_64-linux-gnu.2.17", "{}.so", _X86),
        Platform("linux-arm64", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu.2.17", "{}.so"),
        Platform("win64", "x86_64-pc-windows-gnu", "x86_64-windows-gnu", "{}.dll", _X86),
        Platform("darwin64", "x86_64-apple-macosx11.0.0", "x86_64-macos.11.0", "{}.dylib", _X86),
        Platform("darwin-arm64", "arm64-apple-macosx11.0.0", "aarch64-macos.11.0", "{}.dylib"),
        Platform("wasm32", "wasm32-unknown-wasi", "wasm32-wasi", "{}.wasm", features="+simd128"),
    )
}


def platform_of(name: str) -> Platform:
    """The platform of a name; MicrovibError where there is none."""
    if name not in PLATFORMS:
        raise MicrovibError(f"platform {name} is not known; write some of {', '.join(PLATFORMS)}")
    return PLATFORMS[name]


@cache
def code_objects(platform: Platform) -> dict[str, bytes]:
    """Object files of the compiled functions, by their names without ending; made once and kept in
    the user's cache folder.
    """
    return {
        f"code{ending}": _code_object(platform, processor, ending)
        for processor, ending in platform.processors
    }


def _code_object(platform: Platform, processor: str, ending: str) -> bytes:
    kept_code = [_kept_code(unit) for unit in FUNCTIONS]
    of = (
        llvmlite.__version__,
        platform.triple,
        platform.features,
        processor,
        ending,
        repr([*FUNCTIONS.values()]),
    )
    name = (
        f"export-{platform.name}{ending}-{machine.digest(*kept_code, *(x.encode() for x in of))}.o"
    )
    content = machine.kept(name)
    if content is None:
        content = _object(_linked(ending), platform, processor)
        machine.keep(name, content)
    return content


def image_object(platform: Platform, image: bytes) -> bytes:
    """Object file that holds an image, as ``microvib_image`` and ``microvib_image_bytes``."""
    module = ir.Module("image")
    word = ir.IntType(64)
    words = ir.ArrayType(word, len(image) // 8)
    numbers = [int.from_bytes(image[k : k + 8], "little") for k in range(0, len(image), 8)]
    for name, kind, value in (
        ("microvib_image", words, numbers),
        ("microvib_image_bytes", word, len(image)),
    ):
        held = ir.GlobalVariable(module, kind, name)
        held.initializer, held.global_constant, held.align = ir.Constant(kind, value), True, 8
    made = llvm.parse_assembly(str(module))
    for symbol in made.global_variables:
        symbol.visibility = "hidden"
    return _object(made, platform, platform.processors[0][0])


def _kept_code(unit: Unit) -> bytes:
    try:
        return unit.kept()
    except (OSError, EditedSourcesError):
        raise MicrovibError(
            f"the compiled code in {unit.file} is not of the sources beside it, and cannot be"
            " exported; run `python -m microvib.compiled` first"
        ) from None


def _linked(ending: str) -> llvm.ModuleRef:
    """All functions that are handed on, in one module."""
    whole = None
    for unit, names in FUNCTIONS.items():
        part = _named(unit, names, ending)
        if whole is None:
            whole = part
        else:
            whole.link_in(part)
    return whole


def _named(unit: Unit, names: tuple[str, ...], ending: str) -> llvm.ModuleRef:
    """The kept code of a unit, with nothing but these entries, under the names that C calls."""
    module = llvm.parse_bitcode(lzma.decompress(_kept_code(unit)))
    for function in module.functions:
        if function.is_declaration:
            continue
        if function.name in names:
            function.name = f"{PREFIX}{function.name}{ending}"
            function.visibility = "hidden"  # of two libraries in one process each has its own
        else:
            function.linkage = "internal"
    for held in module.global_variables:
        if not held.is_declaration:
            held.linkage = "internal"
    return module


def _object(module: llvm.ModuleRef, platform: Platform, processor: str) -> bytes:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(platform.triple)
    made_for = target.create_target_machine(
        cpu=processor, features=platform.features, opt=3, reloc="pic", codemodel="default"
    )
    module.triple, module.data_layout = platform.triple, str(made_for.target_data)
    module.verify()
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(made_for, llvm.create_pipeline_tuning_options()))
    return bytes(made_for.emit_object(module))
