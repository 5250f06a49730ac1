"""Static checks of the C: strict compiler warnings, clang-tidy, MISRA C:2012."""

import re
import shutil
from pathlib import Path

from .tools import HERE, HOST, STANDARD, Failed, Machine, Task, attempt, each, hold, need

STRICT = (
    "-pedantic -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Wfloat-conversion "
    "-Wfloat-equal -Wshadow -Wundef -Wcast-qual -Wstrict-prototypes -Wmissing-prototypes -Wvla -Werror"
).split()
DEVIATIONS = HERE / "misra.md"
# macros of gcc for Cortex-M4F, which cppcheck assumes; it reads no system headers
AS_M4F = [f"-D{name}" for name in ("__GNUC__=12", "__STDC_VERSION__=199901L", "__arm__=1", "__ARM_FP=4")] + [
    f"-D{name}" for name in ("FLT_EVAL_METHOD=0", "FLT_RADIX=2", "FLT_MANT_DIG=24", "DBL_MANT_DIG=53")
]


def warnings(task: Task, target: Machine = HOST) -> str:
    """Check that gcc with its analyzer and clang (on a bare target:
    its gcc) give no warning for any source or header."""
    sources = _sources(task)
    commands = [[target.compiler, *target.flags, "-fanalyzer"]]
    if target is HOST:
        commands += [[need("clang", "clang")]]
    flags = ["-O2", *STRICT, *STANDARD, *task.include, "-c", "-o", "/dev/null"]
    jobs: list[list[str | Path]] = [[*command, *flags, source] for command in commands for source in sources]
    answers = each(lambda job: attempt(job), jobs)
    hold(text for code, text in answers if code or text)
    return f"{len(sources)} sources, {', '.join(str(command[0]) for command in commands)}"


def tidy(task: Task) -> str:
    """Check that clang-tidy, with the checks of .clang-tidy, has no finding."""
    need("clang-tidy", "clang-tidy")
    sources = _sources(task)
    command = ["clang-tidy", "--quiet", f"--config-file={task.root / '.clang-tidy'}"]
    answers = each(lambda source: attempt([*command, source, "--", *STANDARD, *task.include]), sources)
    hold(text for code, text in answers if code or "warning:" in text or "error:" in text)
    return f"{len(sources)} sources"


def misra(task: Task) -> str:
    """Check that cppcheck and its MISRA addon have no findings except those listed in misra.md by rule and
    files."""
    need("cppcheck", "cppcheck")
    allowed, used = _deviations(), set()
    findings = _findings(task)
    undocumented = []
    for path, line, rule in findings:
        if task.short and rule.startswith("2."):
            continue  # unused items can be found only in the complete sources
        # what is generated only to be checked is as what is in generated/
        place = Path("generated", "laws", Path(path).name) if "laws" in Path(path).parts else Path(path)
        if any(place.match(files) for files in allowed.get(rule, ())):
            used.add(rule)
        else:
            undocumented.append(f"{path}:{line}: {rule} is not among the deviations of misra.md")
    hold(undocumented)
    if not task.short:
        hold(f"misra.md: nothing deviates from {rule} any more" for rule in sorted(set(allowed) - used))
    return (
        f"0 undocumented, {len(findings)} places deviate from {len({rule for _, _, rule in findings})} "
        "rules with a reason"
    )


def _findings(task: Task) -> list[tuple[str, str, str]]:
    """Return the findings (file, line, rule), each once. The exit code of cppcheck does not depend on those
    of the addon."""
    build = task.folder / "misra"
    # What it keeps of headers that have changed would be found again
    shutil.rmtree(build, ignore_errors=True)
    build.mkdir(parents=True)
    template = "--template={file}:{line}: {id}: {message}"
    command = [
        "cppcheck",
        "-j2",
        "--addon=misra",
        "--enable=style",
        "--std=c99",
        "--quiet",
        f"--cppcheck-build-dir={build}",
        template,
    ]
    # findings that do not apply: functions of both scalars from one text, declarations at the start of a
    # function, no memcpy here
    command += ["--suppress=ctuArrayIndex", "--suppress=variableScope", "--suppress=useStandardLibrary"]
    code, text = attempt([*command, *AS_M4F, *task.include, *_sources(task)])
    if code:
        raise Failed(text)
    findings = set()
    for line in filter(None, text.splitlines()):
        match = re.match(r"(.*?):(\d+): (?:misra-c2012-)?([\w.-]+): ", line)
        if match is None:
            raise Failed(f"cppcheck: {line}")
        path = Path(match[1]).resolve()
        findings.add(
            (str(path.relative_to(task.root) if path.is_relative_to(task.root) else path), match[2], match[3])
        )
    return sorted(findings)


def _deviations() -> dict[str, list[str]]:
    """Return rule -> patterns of the files in which misra.md permits deviations."""
    rows = re.findall(r"^\| ([\d.]+) \|[^|]*\| ([^|]+?) \|", DEVIATIONS.read_text(encoding="utf-8"), re.M)
    return {rule: re.findall(r"`(.*?)`", files) for rule, files in rows}


def _sources(task: Task) -> list[Path]:
    """Return all sources; in the short version a law, the inline functions of the headers,
    and the vehicle."""
    law = task.generated / f"{task.laws[-1]}_f.c" if task.laws else None
    if task.short and law:
        return [law, task.headers(), task.generated / "labmate_follower_f.c"]
    return [*task.sources, task.headers(), *task.firmware]
