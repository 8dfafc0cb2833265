"""From functions that numba compiles to LLVM's code that stands alone: for developers, and where
kept code does not fit.

numba's own functions take its flat arguments and its arrays; each entry gets a function about it
that takes words (``layout``). The users of arrays that compiled functions make are counted by
numba's runtime, which is not there when they run; what they need of it, to get memory, to count and
to give it back, is added here.
"""

from __future__ import annotations

import re
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.core.compiler_lock import global_compiler_lock

from microvib.compiled.layout import Array, Complex, Number, Record
from microvib.compiled.machine import LIBRARY

_BYTES, _WORD, _INT = ir.IntType(8).as_pointer(), ir.IntType(64), ir.IntType(32)
_OWNER = ir.LiteralStructType(
    [_WORD, _BYTES, _BYTES, _BYTES, _WORD, _BYTES]
)  # as numba's MemInfo: count, ..., data, size
_PROCESSORS = ("aarch64", "arm", "ppc", "riscv", "x86")
"""Families of processors that LLVM has instructions of their own for; elsewhere these would end the
process.
"""


@global_compiler_lock
def bitcode(unit: Any) -> bytes:
    """The functions of a ``Unit``, with ``deliver`` for the arrays of results, for any machine of
    64 bits.
    """
    unit.prepare()
    compiled = []
    for entry in unit.entries.values():
        arguments = tuple(numba_type(kind) for kind in entry.signature.arguments.fields)
        entry.dispatcher.compile(arguments)
        compiled.append((entry, entry.dispatcher.overloads[arguments]))
    context = compiled[0][1].target_context
    library = context.codegen().create_library(unit.module)
    module = library.create_ir_module(unit.module)
    _add_memory(module)
    for entry, result in compiled:
        _add_entry(module, context, entry, result)
        library.add_linking_library(result.library)
    library.add_ir_module(module)
    library.finalize()
    return _alone(library.get_llvm_str(), {*unit.entries, "deliver"})


def numba_type(kind: Any) -> Any:
    """numba's type of a ``layout``."""
    if kind is None:
        return types.none
    if isinstance(kind, Number):
        return {float: types.float64, int: types.int64, bool: types.boolean}[kind.type]
    if isinstance(kind, Complex):
        return types.complex128
    if isinstance(kind, Array):
        return types.Array(from_dtype(kind.dtype), kind.ndim, "C")
    fields = [numba_type(field) for field in kind.fields]
    if kind.type:
        return types.NamedTuple(fields, kind.type)
    return types.Tuple(fields)


def _add_entry(module: Any, context: Any, entry: Any, compiled: Any) -> None:
    """A function (words of the arguments, words of the result) -> status about a compiled one."""
    described, made = compiled.fndesc, compiled.signature
    assert made.return_type == numba_type(entry.signature.result), (entry.name, made.return_type)
    function = ir.Function(module, ir.FunctionType(_INT, [_BYTES, _BYTES]), entry.name)
    builder = ir.IRBuilder(function.append_basic_block())
    words = _Words(builder, function.args[0])
    values = [words.read(context, kind) for kind in entry.signature.arguments.fields]
    kind = context.call_conv.get_function_type(described.restype, described.argtypes)
    called = cgutils.get_or_insert_function(module, kind, described.llvm_func_name)
    status, result = context.call_conv.call_function(
        builder, called, made.return_type, made.args, values
    )
    with builder.if_then(status.is_error, likely=False):
        builder.ret(ir.Constant(_INT, 1))
    if entry.signature.result is not None:
        _Words(builder, function.args[1]).write(context, entry.signature.result, result)
    builder.ret(ir.Constant(_INT, 0))


class _Words:
    """Words in memory, taken or filled one after the other."""

    def __init__(self, builder: Any, start: Any) -> None:
        self.builder, self.start, self.count = builder, start, 0

    def place(self, kind: Any) -> Any:
        """Address of the next word."""
        place = self.builder.gep(self.start, [ir.Constant(_WORD, 8 * self.count)])
        self.count += 1
        return self.builder.bitcast(place, kind.as_pointer())

    def word(self, kind: Any = _WORD) -> Any:
        """The next word."""
        return self.builder.load(self.place(kind))

    def read(self, context: Any, kind: Any) -> Any:
        """The value, as numba holds it, whose words come next."""
        builder, numbas = self.builder, numba_type(kind)
        if isinstance(kind, Number):
            if kind.type is bool:
                return builder.icmp_unsigned(
                    "!=", self.word(ir.IntType(8)), ir.Constant(ir.IntType(8), 0)
                )
            return self.word(ir.DoubleType() if kind.type is float else _WORD)
        if isinstance(kind, Complex):
            made = context.make_complex(builder, numbas)
            made.real, made.imag = self.word(ir.DoubleType()), self.word(ir.DoubleType())
            return made._getvalue()
        if isinstance(kind, Record):
            return context.make_tuple(
                builder, numbas, [self.read(context, field) for field in kind.fields]
            )
        array = context.make_array(numbas)(context, builder)
        record = builder.inttoptr(self.word(), _WORD.as_pointer())
        array.data = builder.inttoptr(builder.load(record), array.data.type)
        dimensions = builder.inttoptr(
            builder.load(builder.gep(record, [ir.Constant(_WORD, 2)])), _WORD.as_pointer()
        )
        shape = [
            builder.load(builder.gep(dimensions, [ir.Constant(_WORD, k)])) for k in range(kind.ndim)
        ]
        strides, size = [], ir.Constant(_WORD, kind.dtype.itemsize)  # type: ignore[var-annotated]
        for length in reversed(shape):
            strides.insert(0, size)
            size = builder.mul(size, length)
        array.itemsize = ir.Constant(_WORD, kind.dtype.itemsize)
        array.nitems = builder.sdiv(size, array.itemsize)
        array.shape, array.strides = (
            cgutils.pack_array(builder, shape),
            cgutils.pack_array(builder, strides),
        )
        array.meminfo, array.parent = (
            cgutils.get_null_value(part.type) for part in (array.meminfo, array.parent)
        )
        return array._getvalue()

    def write(self, context: Any, kind: Any, value: Any) -> None:
        """Store a value."""
        builder = self.builder
        if isinstance(kind, Record):
            for k, field in enumerate(kind.fields):
                self.write(context, field, builder.extract_value(value, k))
        elif isinstance(kind, Array):
            array = context.make_array(numba_type(kind))(context, builder, value)
            words = [builder.ptrtoint(array.meminfo, _WORD), builder.ptrtoint(array.data, _WORD)]
            for word in (*words, *cgutils.unpack_tuple(builder, array.shape, kind.ndim)):
                builder.store(word, self.place(_WORD))
        else:
            for part in (
                cgutils.unpack_tuple(builder, value, 2) if isinstance(kind, Complex) else [value]
            ):
                builder.store(part, self.place(part.type))


def _add_memory(module: Any) -> None:
    """Add the functions of numba's runtime that are needed: memory with a count of its users before it, and its end."""
    malloc = ir.Function(module, ir.FunctionType(_BYTES, [_WORD]), "malloc")
    free = ir.Function(module, ir.FunctionType(ir.VoidType(), [_BYTES]), "free")
    function = ir.Function(
        module, ir.FunctionType(_BYTES, [_WORD, _INT]), "NRT_MemInfo_alloc_aligned"
    )
    builder, size = ir.IRBuilder(function.append_basic_block()), function.args[0]
    align, header = builder.zext(function.args[1], _WORD), ir.Constant(_WORD, 48)
    owner = builder.call(malloc, [builder.add(builder.add(size, header), align)])
    with builder.if_then(
        builder.icmp_unsigned("==", owner, ir.Constant(_BYTES, None)), likely=False
    ):
        builder.ret(owner)
    end = builder.add(builder.add(builder.ptrtoint(owner, _WORD), header), align)
    data = builder.inttoptr(builder.sub(end, builder.urem(end, align)), _BYTES)
    fields = builder.bitcast(owner, _OWNER.as_pointer())
    builder.store(ir.Constant(_OWNER, None), fields)
    for place, value in ((0, ir.Constant(_WORD, 1)), (3, data), (4, size)):
        builder.store(value, cgutils.gep_inbounds(builder, fields, 0, place))
    builder.ret(owner)
    _add_count(module, "NRT_incref", 1, None)
    _add_count(module, "NRT_decref", -1, free)
    _add_delivery(module, free)


def _add_count(module: Any, name: str, change: int, free: Any) -> None:
    """One user more or less of an array, if there is one. No other thread sees it, so that counting
    takes no atomic instruction, of which LLVM makes one of this very processor."""
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [_BYTES]), name)
    builder, owner = ir.IRBuilder(function.append_basic_block()), function.args[0]
    with builder.if_then(builder.icmp_unsigned("!=", owner, ir.Constant(_BYTES, None))):
        count = builder.bitcast(owner, _WORD.as_pointer())
        left = builder.add(builder.load(count), ir.Constant(_WORD, change))
        builder.store(left, count)
        if free is not None:
            with builder.if_then(builder.icmp_unsigned("==", left, ir.Constant(_WORD, 0))):
                builder.call(free, [owner])
    builder.ret_void()


def _add_delivery(module: Any, free: Any) -> None:
    """``layout.Deliver``: a result has one user, its caller."""
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [_WORD] * 4), "deliver")
    builder = ir.IRBuilder(function.append_basic_block())
    owner, data, record, count = function.args
    kind = ir.FunctionType(_BYTES, [_BYTES, _BYTES, _WORD])
    copy = cgutils.get_or_insert_function(module, kind, "memcpy")
    to = builder.load(builder.inttoptr(record, _WORD.as_pointer()))
    builder.call(copy, [builder.inttoptr(to, _BYTES), builder.inttoptr(data, _BYTES), count])
    builder.call(free, [builder.inttoptr(owner, _BYTES)])
    builder.ret_void()


_PICKLED = re.compile(
    r'^(@"?\.const\.(?:pickledata|sha1|picklebuf)[^=]*= .*?constant \[\d+ x i8\]) c"[^"]*"',
    re.MULTILINE,
)
"""Exceptions that numba keeps with the paths of this machine's files; no compiled code of ours
raises one.
"""


def _alone(text: str, entries: set[str]) -> bytes:
    """A module with nothing but what entries need, and nothing of this machine."""
    module = llvm.parse_assembly(_PICKLED.sub(r"\1 zeroinitializer", text))
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name not in entries:
            symbol.linkage = "internal"
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_strip_symbols_pass()  # names are more than half of it
    passes.add_strip_dead_prototype_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    needed = {function.name for function in module.functions if function.is_declaration}
    ours = {
        name
        for name in needed
        if name.startswith("llvm.") and name.split(".")[1] not in _PROCESSORS
    }
    foreign = needed - ours - set(LIBRARY)
    if foreign:
        raise RuntimeError(f"compiled code would need {', '.join(sorted(foreign))}")
    module.triple, module.data_layout = "", ""
    return bytes(module.as_bitcode())
