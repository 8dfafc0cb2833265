"""Compiled code that is kept: of these sources, without a compiler, the same as compiled on the spot, and never in the way."""

import ast
import importlib
import importlib.util
import lzma
import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest
from support.rodas4 import loop

import microvib as mv
from microvib import compiled
from microvib.compiled import ahead, codegen, machine, sources
from microvib.signals import tone_fit, tone_kernel
from microvib.solve import decimate, kernel, propagate, propagators, replay

SMALL_UNITS = (kernel, propagators, decimate, tone_kernel, tone_fit)
OF_THE_PACKAGE = (*SMALL_UNITS, propagate, replay)
UNITS = {module.__name__: module.code for module in (*OF_THE_PACKAGE, loop)}
SMALL = '''
"""A unit of every kind of argument and result."""
import math
from typing import NamedTuple

import numpy as np

from microvib.compiled import Complexes, Cube, Matrix, Unit, Vector

code = Unit(__name__)


class Mixed(NamedTuple):
    a: float
    yes: bool
    v: Vector
    m: Matrix


@code.inner(inline="always", error_model="numpy")
def square(x):
    return x * x  # squared


@code.entry(error_model="numpy", _nrt=False)
def numbers(p: Mixed, k: int, z: complex) -> float:
    total = p.a if p.yes else -p.a
    for i in range(p.v.size):
        total += square(p.v[i])
    return total + p.m[k, 1] + z.real - z.imag + math.sin(p.a)


@code.entry(error_model="numpy", _nrt=False)
def fill(m: Matrix, c: Cube) -> None:
    m[0, 0] = c[1, 0, 2]


@code.entry(error_model="numpy")
def arrays(v: Vector, z: Complexes) -> tuple[Matrix, complex, Complexes]:
    m = np.empty((2, v.size))
    for i in range(v.size):
        m[0, i], m[1, i] = v[i], 2.0 * v[i]
    return m, z[0], z.copy()
'''


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty folder for what is kept."""
    monkeypatch.setattr(machine, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A function that imports the small unit, with changes to its text, as in a checkout."""
    path = tmp_path / "small_unit.py"
    monkeypatch.setattr(sources, "editable", lambda: True)
    monkeypatch.setattr(compiled, "_said", set())

    def imported(old="", new=""):
        path.write_text(SMALL.replace(old, new), encoding="utf-8")
        spec = importlib.util.spec_from_file_location("small_unit", path)
        sys.modules["small_unit"] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    yield imported
    sys.modules.pop("small_unit", None)


def results(module):
    """What the small unit makes of some arguments."""
    mixed = module.Mixed(1.5, True, np.arange(3.0), np.arange(6.0).reshape(3, 2))
    m, c, v = np.zeros((1, 1)), np.arange(12.0).reshape(2, 2, 3), np.array([1.0, -2.0])
    v.flags.writeable = False
    module.fill(m, c)
    return (
        module.numbers(mixed, 2, 1.0 + 3.0j),
        m[0, 0],
        *module.arrays(v, np.array([1.0 + 2.0j, 5.0])),
    )


def expected():
    return (
        1.5 + 5.0 + 5.0 + 1.0 - 3.0 + np.sin(1.5),
        8.0,
        [[1.0, -2.0], [2.0, -4.0]],
        1.0 + 2.0j,
        [1.0 + 2.0j, 5.0],
    )


def keep_beside(module):
    """Keep a unit's code as the command does."""
    from microvib.compiled.__main__ import renew

    return renew(module.code)


def test_every_unit_that_is_kept_is_looked_at():
    assert {module.code.file for module in OF_THE_PACKAGE} == set(
        Path(mv.__file__).parent.rglob("*.llvm")
    )


@pytest.mark.parametrize("name", UNITS)
def test_what_is_kept_is_of_these_sources(name):
    """Of this very text and of this meaning, on every Python: where only the meaning fits, each start parses all sources."""
    stamps = UNITS[name].file.read_bytes().partition(b"\n")[0].decode().split()
    assert stamps == list(UNITS[name].stamps()), f"python -m microvib.compiled {name}"


def test_digests_of_meaning_do_not_depend_on_the_interpreter(tmp_path):
    """Python 3.12 unparses strings with fields otherwise than 3.11, and 3.13 dumps trees otherwise than 3.12."""
    text = '''
def f(x: float, *more, key=1e-3) -> str:
    """Say."""
    for k in []:
        pass
    return f"{x!r:>{10}} {'a'} {x + -1j}" "and" f'{more[0]["b"]}' + b"\\0".hex() * None
class C(NamedTuple):
    """Hold."""
'''
    file = tmp_path / "text.py"
    found = []
    for old, new in (
        ("", ""),
        ("pass\n", "pass  # nothing\n\n"),
        ("Say.", "Tell."),
        ("1e-3", "0.001"),
        ("1e-3", "2e-3"),
    ):
        file.write_text(text.replace(old, new), encoding="utf-8")
        found.append(sources.semantic_digest([file]))
    assert found[:4] == ["fd1dbedeb8ef8dfb0527b9e7728893148f0a4c45f4db53dc359cd1e91282b6f2"] * 4
    assert found[4] != found[0]


@pytest.mark.parametrize("name", UNITS)
def test_what_is_kept_names_no_file_of_the_machine_that_made_it(name):
    text = str(
        llvm.parse_bitcode(lzma.decompress(UNITS[name].file.read_bytes().partition(b"\n")[2]))
    )
    for folder in (
        sys.prefix,
        Path(np.__file__).parents[1],
        Path(mv.__file__).parents[1],
        "site-packages",
    ):
        assert str(folder) not in text


def imported_files(path):
    """Files of its own folder that a module imports from."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            _, _, last = node.module.rpartition(".")
            names = [a.name for a in node.names] if last == path.parent.name else [last]
            yield from (path.parent / f"{name}.py" for name in names)


@pytest.mark.parametrize("name", UNITS)
def test_a_unit_names_every_file_that_it_is_made_from(name):
    sources = set(UNITS[name].sources)
    for source in sources:
        missing = {file for file in imported_files(source) if file.exists()} - sources
        assert source.parent != UNITS[name].file.parent or not missing, (
            f"{source.name} imports from {missing}"
        )


def said_by(script, folder, timeout):
    """What a program prints that runs in a folder, and keeps its machine code there."""
    environment = os.environ | dict.fromkeys(
        ("XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"), str(folder)
    )
    command = [sys.executable, "-c", script]
    run = subprocess.run(
        command,
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=timeout,
    )
    return run.stdout


def test_a_first_run_needs_no_compiler_and_leaves_the_largest_unit_to_another_process(tmp_path):
    script = """
import sys
from microvib.cli.main import main
from microvib.compiled import ahead, codegen
ahead.cores, make, made = lambda: 2, codegen.object_file, []
codegen.object_file = lambda code, *host: made.append(code) or make(code, *host)
settings = "--set record.duration=4s --set record.settle=1s --lines-only".split()
main(["run", "state-1", *settings], standalone_mode=False)
from microvib.solve import propagate
print("numba" in sys.modules, "llvmlite" in sys.modules, len(made), propagate.code.kept() in made)
"""
    said = said_by(script, tmp_path, timeout=300)
    assert said.splitlines()[-1].split() == ["False", "True", "5", "False"]


@pytest.fixture
def begun(monkeypatch):
    """Processes that were started ahead, on a machine that has cores for them."""
    started, start = [], subprocess.Popen
    monkeypatch.setattr(ahead, "cores", lambda: 2)
    monkeypatch.setattr(
        ahead.subprocess, "Popen", lambda *a, **k: started.append(start(*a, **k)) or started[-1]
    )
    yield started
    assert all(process.poll() is not None for process in started), "a process is left"


def test_what_another_process_makes_is_the_same(small, cache, begun, monkeypatch):
    keep_beside(small())
    made, make = [], codegen.object_file
    monkeypatch.setattr(codegen, "object_file", lambda *a: made.append(make(*a)) or made[-1])
    assert results(small())[0] == expected()[0]
    (own,) = cache.iterdir()
    alone = own.read_bytes()
    own.unlink()
    module = small()
    module.code.begin()
    assert results(module)[0] == expected()[0]
    assert own.read_bytes() == alone
    assert (len(begun), len(made)) == (1, 1)
    small().code.begin()
    assert len(begun) == 1, "there is nothing left to make"


def test_who_waits_makes_what_comes_next(small, cache, begun, tmp_path, monkeypatch):
    keep_beside(small())
    slow = tmp_path / "slow.py"
    slow.write_text("import time; time.sleep(600)")
    monkeypatch.setattr(codegen, "__file__", str(slow))
    module, calls = small(), []

    class Next:
        @property
        def addresses(self):
            calls.append("made")
            begun[0].kill()
            begun[0].wait()

    module.code.begin(Next(), Next())
    assert results(module)[0] == expected()[0]
    assert calls == ["made"], (
        "the second waits for its turn, since there is nothing to wait for any more"
    )


@pytest.mark.parametrize(
    "fault", ["raise SystemExit(1)", "", "import time; time.sleep(600)", "import no_such_module"]
)
def test_where_the_other_process_fails_code_is_made_here(
    fault, small, cache, begun, tmp_path, monkeypatch
):
    keep_beside(small())
    program = tmp_path / "program.py"
    program.write_text(fault)
    monkeypatch.setattr(codegen, "__file__", str(program))
    monkeypatch.setattr(ahead, "PATIENCE", 2.0)
    module = small()
    module.code.begin()
    assert results(module)[0] == expected()[0]
    assert len(begun) == 1
    assert [path.suffix for path in cache.iterdir()] == [".o"], "kept, and without numba"


def test_no_process_where_it_would_be_in_the_way(small, cache, begun, monkeypatch):
    keep_beside(small())
    for where, name, value in (
        (ahead, "cores", lambda: 1),
        (sys, "frozen", True),
        (sys, "executable", ""),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, value, raising=False)
            small().code.begin()
    small("x * x", "x * x * x").code.begin()  # edited: what is kept is of no use
    assert begun == []
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", "no such program")
        module = small()
        module.code.begin()
        assert results(module)[0] == expected()[0]


def test_the_other_process_ends_with_this_one(small, tmp_path):
    keep_beside(small())
    (tmp_path / "slow.py").write_text("import time; time.sleep(600)")
    script = """
from microvib.compiled import ahead, codegen
import small_unit
ahead.cores, codegen.__file__ = lambda: 2, "slow.py"
small_unit.code.begin()
print(*[making.process.pid for making in ahead._begun.values()])
"""
    said = said_by(script, tmp_path, timeout=60)
    with pytest.raises(ProcessLookupError):
        os.kill(int(said), 0)


def test_code_that_is_kept_is_used_and_edits_are_not_missed(small, cache):
    for kind, part in zip(results(small()), expected(), strict=True):
        assert np.array_equal(kind, part)
    assert sorted(path.suffix for path in cache.iterdir()) == [".llvm", ".o"]
    assert keep_beside(small()).startswith("made")
    for path in cache.iterdir():
        path.unlink()
    commented = small("# squared", "# in comments nothing is meant")
    assert results(commented)[0] == expected()[0]
    assert [path.suffix for path in cache.iterdir()] == [".o"]
    assert keep_beside(commented).startswith("as it was")
    edited = small("x * x", "x * x * x")
    assert results(edited)[0] == expected()[0] + 4.0
    assert sorted(path.suffix for path in cache.iterdir()) == [".llvm", ".o", ".o"]


def test_an_installed_package_takes_what_is_kept_without_a_look_at_sources(
    small, cache, monkeypatch, capsys
):
    keep_beside(small())
    edited = small("x * x", "x * x * x")
    monkeypatch.setattr(sources, "editable", lambda: False)
    monkeypatch.setattr(sources, "_text", lambda file: pytest.fail(f"{file} is read"))
    assert results(edited)[0] == expected()[0]
    assert capsys.readouterr().err == ""


def test_a_package_is_edited_in_a_checkout_alone(tmp_path, monkeypatch):
    for folder, project, editable in (
        ("src", True, True),
        ("src", False, False),
        ("site-packages", True, False),
    ):
        (tmp_path / folder / "microvib").mkdir(parents=True, exist_ok=True)
        (tmp_path / "pyproject.toml").unlink(missing_ok=True)
        if project:
            (tmp_path / "pyproject.toml").touch()
        monkeypatch.setattr(sources, "PACKAGE", tmp_path / folder / "microvib")
        assert sources.editable() == editable


def test_refused_code_is_said_once_with_what_to_do(small, cache, monkeypatch, capsys):
    keep_beside(small())
    assert capsys.readouterr().err == ""
    for _ in range(2):
        results(small("x * x", "x * x * x"))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("Note: small_unit.llvm was compiled from other sources")
    assert "run `python -m microvib.compiled`" in line
    monkeypatch.setattr(sources, "editable", lambda: False)
    small().code.file.write_bytes(b"- -\n" + lzma.compress(b"of another LLVM"))
    assert results(small())[0] == expected()[0]
    (line,) = capsys.readouterr().err.splitlines()
    assert "small_unit.llvm cannot be used (" in line
    assert "installing microvib again" in line


def test_code_that_cannot_be_read_or_linked_is_compiled_on_the_spot(small, cache, monkeypatch):
    module = small()
    module.code.file.write_bytes(
        " ".join(module.code.stamps()).encode() + b"\n" + lzma.compress(b"of another LLVM")
    )
    assert results(module)[0] == expected()[0]
    module = small()
    monkeypatch.setattr(machine, "load", lambda *_: 1 / 0)
    assert results(module)[0] == expected()[0]
    assert module.code.addresses == {}


def test_only_a_folder_of_ones_own_is_trusted(small, cache):
    cache.mkdir()
    if sys.platform != "win32":
        cache.chmod(0o777)
        machine.keep("unit-1.o", b"code")
        assert list(cache.iterdir()) == []
        cache.chmod(0o700)
    machine.keep("unit-1.o", b"code")
    assert machine.kept("unit-1.o") == b"code"
    (cache / "unit-1.o").write_bytes((cache / "unit-1.o").read_bytes()[:-1])
    assert machine.kept("unit-1.o") is None


def test_no_folder_is_needed(small, cache):
    cache.write_text("a file where the folder would be")
    machine.keep("unit-1.o", b"code")
    assert machine.kept("unit-1.o") is None
    assert results(small())[0] == expected()[0]


def test_what_is_kept_does_not_pile_up(cache):
    for k in range(20):
        machine.keep(f"unit-{k}.o", bytes([k]))
        machine.keep(f"another-{k}.o", bytes([k]))
    assert len(list(cache.iterdir())) == 2 * machine.MAX_KEPT_VERSIONS
    assert machine.kept("unit-19.o") == bytes([19])


@pytest.mark.parametrize("wrong", [np.arange(3), np.zeros((2, 2)), np.arange(6.0)[::2]])
def test_arrays_of_another_kind_are_refused(wrong):
    with pytest.raises(TypeError, match="where a contiguous one of 1 of float64 is expected"):
        tone_kernel.floors(wrong, np.zeros(10, complex))


@pytest.mark.release
def test_what_is_kept_is_what_numba_makes(state_1, tmp_path, monkeypatch):
    """To the last bit: of lanes (the filter), of tables, of friction; made for the processor that kept code is made for.

    The loops of both methods take ten times as long to compile as these, and come the same way. For longer vectors than that
    processor's numba makes other code, whose last digits differ.
    """
    units = [module.code for module in (decimate, propagators, kernel)]
    script = f"""
from importlib import import_module
from microvib.compiled.__main__ import for_common_processor
for_common_processor()
from microvib.compiled.build import bitcode
for name in {[unit.module for unit in units]!r}:
    open(name, "wb").write(bitcode(import_module(name).code))
"""
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True, timeout=300)
    scenario = state_1.with_si({"record.duration": 1.0, "record.settle": 0.5})
    ours, used = mv.simulate(scenario), []
    for unit in units:
        addresses = machine.load(
            unit.module, (tmp_path / unit.module).read_bytes(), [*unit.entries, "deliver"]
        )
        for name, entry in unit.entries.items():
            made = entry.signature.caller(addresses[name], addresses["deliver"])
            monkeypatch.setitem(entry.__dict__, "_compiled", noting(used, name, made))
    theirs = mv.simulate(scenario)
    assert set(used) >= {"filter_and_decimate", "tabulate", "initial_friction"}
    for name, samples in ours.channels.items():
        assert np.array_equal(samples, theirs.channels[name]), name


def noting(used, name, function):
    """A function that notes that it was used."""
    return lambda *arguments: used.append(name) or function(*arguments)


@pytest.mark.release
@pytest.mark.parametrize(
    ("triple", "names"),
    [
        ("arm64-apple-darwin22.0.0", [module.__name__ for module in OF_THE_PACKAGE]),
        ("aarch64-unknown-linux-gnu", [module.__name__ for module in SMALL_UNITS]),
        ("x86_64-pc-windows-msvc", [module.__name__ for module in SMALL_UNITS]),
    ],
)
def test_code_for_other_machines_is_made(triple, names):
    """In a process of its own, for what LLVM cannot do ends it. The large units differ from the small ones in length only."""
    script = f"""
from importlib import import_module
import llvmlite.binding as llvm
from microvib.compiled import codegen
llvm.initialize_all_targets(); llvm.initialize_all_asmprinters()
for module in map(import_module, {names!r}):
    code = module.code.file.read_bytes().partition(b"\\n")[2]
    print(len(codegen.object_file(code, {triple!r}, "generic", "")) > 5_000)
"""
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=300
    )
    assert run.stdout.splitlines() == ["True"] * len(names)
