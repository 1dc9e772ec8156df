"""Compile parts of the kernel into object files: `python -m` this module, FOLDER FILE.NAME ..."""

from __future__ import annotations

import gc
import importlib
import re
import sys
from pathlib import Path

from llvmlite import binding as llvm

from drivetool.drive.compile import defer_code_generation, store, symbol

# Functions that Numba's wrapper calls to pass on an exception. The kernel raises none, and its code may be loaded
# without Numba: a call of one of them becomes a trap.
INTERPRETER_CALLS = re.compile(r"^declare ([^@\n]*@(?:numba_|NRT_|Py)\w+\([^\n]*?\))[^)\n]*$", re.MULTILINE)


def build(part: str, folder: Path) -> None:
    """Write the object file of a part."""
    file, name = part.split(".")
    made = getattr(importlib.import_module(f"{__package__}.{file}"), name).made()
    code = made.inspect_llvm().replace(made.native_name, symbol(name))
    code = INTERPRETER_CALLS.sub(r"define internal \1 {\n  call void @llvm.trap()\n  unreachable\n}", code)
    if "declare void @llvm.trap()" not in code:
        code += "\ndeclare void @llvm.trap()\n"
    module, machine = llvm.parse_assembly(code), _machine()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization, options.slp_vectorization = True, False
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    module.verify()
    store(folder, name, machine.emit_object(module))


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


if __name__ == "__main__":
    defer_code_generation()
    gc.disable()  # all objects are needed until the process ends
    for part in sys.argv[2:]:
        build(part, Path(sys.argv[1]))
