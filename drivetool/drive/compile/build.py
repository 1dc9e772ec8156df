"""Compile parts of the kernel: `python -m` this module, STARTER FOLDER FILE.NAME ..., or --lower.

STARTER is the id of the process that wants them; --lower makes the text of all that comes with the sources.
Numba lowers a part to LLVM text, which depends on the sources alone, and LLVM makes machine code for this processor
of it. Where the text of these sources is stored, Numba is not needed.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import llvmlite
from llvmlite import binding as llvm

from drivetool.drive.compile.lowered import ARCHIVES, SOURCES, text_of, write_archive
from drivetool.drive.compile.machine_code import COMPILED_WITH, KERNEL, only_compiler, store, symbol

# Functions that Numba's wrapper calls to pass on an exception. The kernel raises none, and its code may be loaded
# without Numba: a call of one of them becomes a trap.
INTERPRETER_CALLS = re.compile(r"^declare ([^@\n]*@(?:numba_|NRT_|Py)\w+\([^\n]*?\))[^)\n]*$", re.MULTILINE)
# Those of the processor that lowers; the one that emits has its own.
TARGET_LINES = re.compile(r"^target (?:triple|datalayout) = .*$\n", re.MULTILINE)
# An attribute of LLVM's own functions, which it knows without the text; LLVM 20 does not read the word.
NEW_ATTRIBUTE = "nocreateundeforpoison "
PR_SET_PDEATHSIG = 1  # of <linux/prctl.h>


def lowered(part: str) -> str:
    """The LLVM text of a part, made by Numba; without it the process ends with a sentence."""
    try:
        from drivetool.drive.compile.numba_private import defer_code_generation
    except ModuleNotFoundError as error:
        sys.exit(f"neither LLVM text of {part} that llvmlite {llvmlite.__version__} reads, nor {error.name}, "
                 "which makes it")
    defer_code_generation()
    gc.disable()  # all objects are needed until the process ends
    file, name = part.split(".")
    made = getattr(importlib.import_module(f"{KERNEL}.{file}"), name).made()
    code = TARGET_LINES.sub("", made.inspect_llvm().replace(made.native_name, symbol(name)))
    code = INTERPRETER_CALLS.sub(r"define internal \1 {\n  call void @llvm.trap()\n  unreachable\n}", code)
    code = code.replace(NEW_ATTRIBUTE, "")
    return code if "declare void @llvm.trap()" in code else f"{code}\ndeclare void @llvm.trap()\n"


def emitted(text: str) -> bytes:
    """The object file of a text, for this processor."""
    module, machine = llvm.parse_assembly(text), _machine()
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    # Unrolled loops take two fifths of this time, and are no faster: the columns are vectorised by fours.
    options.loop_vectorization, options.slp_vectorization, options.loop_unrolling = True, False, False
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    module.verify()
    return machine.emit_object(module)


def _machine() -> llvm.TargetMachine:
    """This processor, with addresses of any length: code and libraries may lie far from each other."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target, features = llvm.Target.from_default_triple(), llvm.get_host_cpu_features().flatten()
    x86 = target.name.startswith("x86")
    # Columns come in fours: longer vectors would leave a scalar remainder.
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=features + ",+prefer-256-bit" if x86 else features, opt=3, jit=True,
        reloc="static" if x86 else "default", codemodel="jitdefault")


def lower_all(place: Path) -> None:
    """Store the text of every part."""
    texts = {part: lowered(part) for part in COMPILED_WITH}
    plain = [part for part in texts if not part.startswith(("smooth", "laws")) and not part.endswith("_laws")]
    for archive, parts in zip(ARCHIVES, (plain, [part for part in texts if part not in plain]), strict=True):
        write_archive(place / archive, {part: texts[part] for part in parts})


def end_with(starter: int) -> None:
    """On Linux this process is ended with the one of this id that has started it, however that ends."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != starter:  # it has ended already
            sys.exit()


def compile_parts(place: Path, parts: Sequence[str]) -> None:
    """Store the machine code of the parts that are still missing, and print each name once the part is there."""
    for part in parts:
        name = part.partition(".")[2]
        with only_compiler(place, name) as missing:
            if missing:
                store(place, name, object_of(part))
        print(part, flush=True)


def object_of(part: str) -> bytes:
    """The object file of a part, from its text where this LLVM reads it, else lowered here."""
    with suppress(RuntimeError):
        if text := text_of(part):
            return emitted(text)
    return emitted(lowered(part))


if __name__ == "__main__":
    if sys.argv[1] == "--lower":
        lower_all(SOURCES / "kernel")
    else:
        end_with(int(sys.argv[1]))
        compile_parts(Path(sys.argv[2]), sys.argv[3:])
