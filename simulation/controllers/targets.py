"""The targets of firmware/boards/targets.toml: how C is compiled and run on each. The host is one of them.

Every image except the host's is freestanding: start-up code and linker script are those of firmware/boards,
and only the compiler's own arithmetic library is linked.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...codegen.targets import BOARDS, TABLE, flags
from ...readers.errors import BadInput

QUIET = ("-display", "none", "-monitor", "none", "-serial", "none")
SEMIHOSTING = ("-semihosting-config", "enable=on,target=native")
CONSOLE = ("-chardev", "stdio,id=console", "-semihosting-config", "enable=on,target=native,chardev=console")

PACKAGES = {  # tool -> Debian package
    "gcc": "gcc",
    "clang": "clang",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "arm-none-eabi-g++": "gcc-arm-none-eabi",
    "riscv64-unknown-elf-gcc": "gcc-riscv64-unknown-elf",
    "wasm-ld": "lld",
    "qemu-system-arm": "qemu-system-arm",
    "qemu-system-riscv32": "qemu-system-misc",
    "node": "nodejs",
    "g++": "g++",
    "clang++": "clang",
    "ld.lld": "lld",
    "frama-c": "frama-c-base",
    "objdump": "binutils",
    "nm": "binutils",
}


@dataclass(frozen=True)
class Target:
    """A target that runs C, and how its images are built.

    `compiler`: the one that links, and compiles unless another is chosen; empty: any. `clang`: name of the
    target for clang. `start`: sources of firmware/boards that are in each image. `machine`: command of the
    emulator; none on the host.
    """

    name: str
    compiler: str = ""
    clang: str = ""
    flags: tuple[str, ...] = ()
    start: tuple[str, ...] = ()
    script: str = ""
    machine: tuple[str, ...] = ()

    @property
    def bare(self) -> bool:
        """Whether there is no operating system."""
        return bool(self.start)

    def compile(self, compiler: str = "") -> list[str]:
        """Return the compiler and its flags for this target, without those of optimization and standard."""
        chosen = compiler or self.compiler
        named = [f"--target={self.clang}"] if chosen == "clang" and self.clang else []
        return [chosen, *named, *self.flags, *["-ffreestanding"] * self.bare]

    def link(self) -> list[str]:
        """Return the options that link objects to an image; the linker script is in the current folder."""
        return ["-nostdlib", "-T", self.script, "-lgcc"] if self.script else []

    def run(self, image: str, *options: str) -> list[str]:
        """Return the command that runs an image, with options of the emulator."""
        return (
            [*self.machine, *QUIET, *options, "-kernel", image]
            if self.machine
            else [os.path.join(".", image)]
        )

    def files(self) -> dict[str, str]:
        """Return the files of firmware/boards that an image needs: file name -> text."""
        headers = [path.name for path in BOARDS.glob("*.h")] if self.bare else []
        names = (*self.start, *headers, *[self.script] * bool(self.script))
        return {name: (BOARDS / name).read_text(encoding="utf-8") for name in names}

    def missing(self, *tools: str) -> list[str]:
        """Return the missing tools, of those that build and run an image, and of others."""
        return missing(self.compiler, *self.machine[:1], *tools)


def _target(name: str, row: Mapping[str, Any]) -> Target:
    """Return a target of the table."""
    toolchain = TABLE["toolchain"][row["toolchain"]]
    words = {key: tuple(row.get(key, ())) for key in ("start", "machine")}
    return Target(
        name, f"{toolchain['prefix']}gcc", toolchain["clang"], flags(name), script=row["script"], **words
    )


HOST = Target("host")
WASM = Target("wasm32", clang="wasm32", start=("string.c",))  # linked by lld, run by Node: see who does
TARGETS: Mapping[str, Target] = {
    "host": HOST,
    **{name: _target(name, row) for name, row in TABLE["target"].items() if "processor" not in row},
    "wasm32": WASM,
}


def missing(*tools: str) -> list[str]:
    """Return which of these tools are missing; empty names are ignored."""
    return [tool for tool in dict.fromkeys(tools) if tool and not shutil.which(tool)]


def require(*tools: str) -> None:
    """Raise BadInput naming the package if a tool is missing."""
    for tool in missing(*tools):
        package = PACKAGES.get(tool, tool)
        raise BadInput(f"{tool} is not installed; on Debian and Ubuntu it is in the package {package}")


def required() -> bool:
    """Return whether a missing tool is a failure: $NOSLIP_REQUIRE_FIRMWARE = 1."""
    return os.environ.get("NOSLIP_REQUIRE_FIRMWARE") == "1"
