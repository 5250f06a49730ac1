"""Runs the C on arbitrary arguments: sanitizers with seeded random numbers, and libFuzzer."""

import base64
import re
import shutil
from pathlib import Path

from .tools import HERE, STANDARD, Failed, Missing, Task, attempt, each, need, run

CHECKS = "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow"
# Where its step would leave, a lane goes on, and the step computes it again
LANES_MAY = ["-fno-sanitize=float-divide-by-zero"]
RUNTIME = (
    "odometry",
    "ekf",
    "adaptation",
    "integral",
    "angles",
    "path",
    "velocity",
    "motor",
    "profile",
    "approach",
    "slip",
    "course",
    "balance",
    "disturbance",
)
SCALARS = {"double": "", "float": "_f"}
CORPUS = HERE / "corpus.txt"  # one input per line: the function that it is for, and its bytes in base64
RUNS = {True: 20_000, False: 500_000}  # of libFuzzer, short or not; README.md describes longer campaigns
SEEDED = {True: 10_000, False: 200_000}  # calls of each function
LONGEST = 512  # maximum bytes of an input


def sanitizers(task: Task) -> str:
    """Check that calls of every function with seeded arguments, including arbitrary bits, give no report, and
    that the digest of all laws is the same."""
    gcc = need("gcc", "gcc")
    folder = _folder(task, "sanitizers")
    (folder / "seeded.c").write_text(_drivers(task) + SEEDED_MAIN, encoding="utf-8")
    (folder / "probe.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
    if attempt([gcc, CHECKS, folder / "probe.c", "-o", folder / "probe"])[0]:
        raise Missing("install gcc with libasan and libubsan")
    flags = [_level(task), CHECKS, "-fno-sanitize-recover=all"]
    seeded = _program(task, folder, gcc, flags, folder / "seeded.c")
    counted = _rows(run([seeded, str(SEEDED[task.short])]))
    if task.short:
        return f"{len(counted)} functions, {SEEDED[True]} calls each"
    digest = task.root / "tests/c/law_digest.c"
    plain, checked = (
        _program(task, _folder(task, name), gcc, more, digest)
        for name, more in (("plain", ["-O2"]), ("checked", flags))
    )
    if len({run([program, "20000", "20000"]) for program in (plain, checked)}) != 1:
        raise Failed("the digest differs with sanitizers")
    return f"{len(counted)} functions, {SEEDED[False]} calls each; the digest of 20000 states"


def fuzz(task: Task) -> str:
    """Check that libFuzzer with the sanitizers, starting from the committed corpus, has no finding."""
    clang = need("clang", "clang")
    folder = _folder(task, "fuzz")
    (folder / "fuzz.c").write_text(_drivers(task) + FUZZ_MAIN, encoding="utf-8")
    flags = [_level(task), CHECKS.replace("=", "=fuzzer,"), "-fno-sanitize-recover=all"]
    probe = "int LLVMFuzzerTestOneInput(const char *x, unsigned long n) { return x == 0 && n > 9; }\n"
    (folder / "probe.c").write_text(probe, encoding="utf-8")
    if attempt([clang, flags[1], folder / "probe.c", "-o", folder / "probe"])[0]:
        raise Missing("install libclang-rt-14-dev (of the version of the installed clang)")
    program = _program(task, folder, clang, flags, folder / "fuzz.c")
    names = _functions(task)
    corpus, new_inputs = _unpacked(folder, names), _empty(folder / "found")
    summary = _fuzz(program, [f"-runs={RUNS[task.short]}", "-seed=1992"], new_inputs, corpus)
    if task.update:
        merged = _empty(folder / "merged")
        run([program, "-merge=1", "-use_counters=0", f"-max_len={LONGEST}", merged, corpus, new_inputs])
        inputs = [_packed(path.read_bytes(), names) for path in merged.iterdir()]
        CORPUS.write_text(
            "".join(f"{line}\n" for line in sorted(inputs, key=lambda line: (len(line), line))),
            encoding="utf-8",
        )
        summary += f"; corpus of {len(inputs)} inputs"
    return summary


def _fuzz(program: Path, options: list[str], new_inputs: Path, corpus: Path) -> str:
    """Run libFuzzer: writes new inputs to `new_inputs`, and a failing one to the folder of the program;
    returns a summary."""
    fixed = [f"-max_len={LONGEST}", "-print_final_stats=1", f"-artifact_prefix={program.parent}/"]
    code, text = attempt([program, *options, *fixed, new_inputs, corpus])
    if code:
        # Of a check, of UBSan, of the other sanitizers
        report = re.search(r"^.*(: not |: runtime error: |ERROR: )", text, re.M)
        raise Failed(text[report.start() :][:3000] if report else text[-3000:])
    runs = re.findall(r"number_of_executed_units: (\d+)", text)[-1]
    edges, features = re.findall(r"cov: (\d+) ft: (\d+)", text)[-1]
    return f"{runs} runs, {edges} edges, {features} features, 0 findings"


def _unpacked(folder: Path, names: list[str]) -> Path:
    """Unpack the committed corpus into a folder: the inputs for the functions of these names.

    The first byte of an input is the position of its function in the table, which another function may move:
    so the name is kept.
    """
    corpus = _empty(folder / "corpus")
    for number, line in enumerate(CORPUS.read_text(encoding="utf-8").splitlines()):
        name, encoded = line.split()
        if name in names:
            (corpus / str(number)).write_bytes(bytes([names.index(name)]) + base64.b64decode(encoded))
    return corpus


def _packed(content: bytes, names: list[str]) -> str:
    """Return the line of the corpus for an input of libFuzzer."""
    return f"{names[content[0] % len(names)]} {base64.b64encode(content[1:]).decode()}"


def _empty(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _folder(task: Task, name: str) -> Path:
    folder = task.folder / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _level(task: Task) -> str:
    """Return the optimization level; in the short version most of the time is compilation."""
    return "-O0" if task.short else "-O1"


def _functions(task: Task) -> list[str]:
    """Return the names of the laws and of the parts of the runtime that are called, in both scalars."""
    return [name + suffix for name in (*task.laws, *RUNTIME) for suffix in SCALARS.values()]


def _drivers(task: Task) -> str:
    """Return C with a driver function of the same type for each law and each part of the runtime,
    and a table of them."""
    names = {"angle", "reversing", *RUNTIME} - {"angles", "ekf"}
    runtime = [*(f"noslip_{name}.h" for name in sorted(names)), "labmate_ekf.h", "labmate_ekf_f.h"]
    parts = [f'#include "{header}"\n' for header in ("law_fuzz.h", *runtime)] + ["#define ROBOT labmate\n"]
    for real, suffix in SCALARS.items():
        parts.append(f"#define SUFFIX {suffix}\n#define REAL {real}\n")
        parts += [
            f'#include "lanes/{law}_steps{suffix}.h"\n' + task.driver(law, suffix, "law_fuzz.inc")
            for law in task.laws
        ]
        parts.append('#include "runtime_fuzz.inc"\n#undef SUFFIX\n#undef REAL\n')
    rows = [
        f'    {{"{name}", {"fuzz" if name.removesuffix("_f") in RUNTIME else "run"}_{name}}},\n'
        for name in _functions(task)
    ]
    return "".join(parts) + TABLE + "".join(rows) + "};\n"


def _program(task: Task, folder: Path, compiler: str, flags: list[str], source: Path) -> Path:
    """Compile and link all sources with a driver."""
    include = [*task.include, f"-I{task.root / 'tests/c'}"]
    command = [compiler, *STANDARD, *flags, *include]

    def compiled(path: Path) -> Path:
        run(
            [
                *command,
                *(LANES_MAY if path in task.lanes else []),
                "-c",
                path,
                "-o",
                folder / f"{path.stem}.o",
            ]
        )
        return folder / f"{path.stem}.o"

    objects = each(compiled, [*task.sources, *task.lanes, source])
    run([*command, *objects, "-lm", "-o", folder / "program"])
    return folder / "program"


def _rows(text: str) -> dict[str, list[int]]:
    """Return function -> number of calls by kind of result,
    for a law also of follow. Raises Failed if hardly any succeeded."""
    rows: dict[str, list[int]] = {}
    for line in text.splitlines():
        name, *words = line.split()
        counted = [int(word) for word in words]
        rows |= {name: counted[:8]} | ({f"{name} follow": counted[8:]} if any(counted[8:]) else {})
    if idle := [name for name, counted in rows.items() if counted[-2] < 100]:
        raise Failed(f"hardly any successful call of {', '.join(idle)}: the arguments do not test it")
    return rows


TABLE = """
typedef void fuzz_function(fuzz_source *from, uint32_t n, const char *name, unsigned long *counted);
static const struct {
    const char *name;
    fuzz_function *run;
} functions[] = {
"""
SEEDED_MAIN = """
int main(int argc, char **argv)
{
    int i, k;
    for (i = 0; argc == 2 && i < COUNT(functions); i++) {
        fuzz_source from = {7, NULL, 0};
        unsigned long counted[16] = {0};
        functions[i].run(&from, (uint32_t)strtoul(argv[1], NULL, 10), functions[i].name, counted);
        printf("%s", functions[i].name);
        for (k = 0; k < COUNT(counted); k++) {
            printf(" %lu", counted[k]);
        }
        printf("\\n");
    }
    return argc != 2;
}
"""
FUZZ_MAIN = """
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t count)
{
    if (count > 1) {
        fuzz_source from = {1, bytes + 1, count - 1};
        unsigned long counted[16] = {0};
        const unsigned i = bytes[0] % (unsigned)COUNT(functions);
        functions[i].run(&from, 64, functions[i].name, counted);
    }
    return 0;
}
"""
