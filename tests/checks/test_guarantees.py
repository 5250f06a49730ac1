"""The guarantees, each in its short version; that each check refuses what it must; and the budget."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from noslip.checks.guarantees import budget, eva, fuzz, instructions, memory, timing, tools
from noslip.checks.guarantees.__main__ import CHECKS, FEEDBACKS, MORE, OTHERS, checked
from noslip.checks.guarantees.tools import HOST, M4F, ROOT, Failed, Machine, Missing, Task
from noslip.readers.robots import find_robot
from noslip.tests.tools import need

# test_runtime.py has the others already, test_faults.py the faults
SHORT = [name for name in CHECKS if name not in ("symbols", "sizes", "warnings", "warnings-m4f", "faults")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("guarantees")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly) if name == "timing" else name for name in SHORT]
)
def test_guarantee(name, folder):
    end, summary = checked(name, Task(folder, short=True))
    if end == "skipped":
        pytest.skip(summary)
    assert end == "holds", summary


def test_missing_tools_are_skipped_unless_required(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("NOSLIP_REQUIRE_FIRMWARE", raising=False)
    for name in CHECKS:
        end, summary = checked(name, Task(tmp_path, short=True))
        assert end == "skipped" and summary.startswith("install "), name
    monkeypatch.setenv("NOSLIP_REQUIRE_FIRMWARE", "1")
    assert {checked(name, Task(tmp_path, short=True))[0] for name in CHECKS} == {"FAILED"}


def test_a_tool_that_does_not_end_is_a_failure(monkeypatch):
    monkeypatch.setattr(tools, "TIMEOUT", 0.1)
    with pytest.raises(Failed, match=r"sleep has not ended after 0.1 s"):
        tools.attempt(["sleep", "60"])


@pytest.mark.nightly
@pytest.mark.parametrize("planted", [False, True])
def test_eva_proves_damped_laws_and_finds_what_is_wrong_within_the_band(planted, tmp_path):
    need("frama-c")
    task, law = Task(tmp_path, more=MORE), f"labmate_{MORE[0]}"
    program, source = eva.AnalysedProgram("law", "float", law), task.law_file(f"{law}_f.c")
    if not planted:
        proved, wrong = eva.analyse(task, program)
        assert proved > 10 and not wrong
        return
    head, within, body = source.read_text().rpartition(f"{law}_step_near_f_law(const")
    assert head and "tau[1] =" in body
    source.write_text(head + within + body.replace("tau[1] =", "tau[2] =", 1))
    assert any(
        "accessing out of bounds index" in line or "out of bounds" in line
        for line in eva.analyse(task, program)[1]
    )


@pytest.mark.nightly
@pytest.mark.parametrize("name", eva.EXTENDED)
def test_eva_proves_extended_laws_and_finds_an_extension_that_is_not_checked(name, tmp_path):
    need("frama-c")
    task, law = Task(tmp_path, more=(name,)), f"labmate_{name}"
    program, source = eva.AnalysedProgram("law", "float", law), task.law_file(f"{law}_f.c")
    proved, wrong = eva.analyse(task, program)
    assert proved > 10 and not wrong
    text = source.read_text()
    wrong_step = text.replace("self->extension[0] =", "self->extension[1] =")
    assert wrong_step != text
    source.write_text(wrong_step)
    assert eva.analyse(task, program)[1]


@pytest.mark.nightly
@pytest.mark.parametrize("robot", ["balancer", "roller_racer", "tractor_trailer:6"])
def test_eva_proves_partial_linearization_and_finds_what_is_wrong(robot, tmp_path):
    """A law of a robot with fewer inputs than degrees of freedom, and a long one;
    the planted defect writes beside the inputs."""
    need("frama-c")
    task = Task(tmp_path, others=((robot, dict(OTHERS)[robot]),))
    (law,) = task.laws_of_others
    program, source = eva.AnalysedProgram("law", "float", law), task.law_file(f"{law}_f.c")
    proved, wrong = eva.analyse(task, program)
    assert proved > 10 and not wrong
    text, last = source.read_text(), len(find_robot(robot).inputs) - 1
    wrong_step = text.replace(f"tau[{last}] = ", f"tau[{last + 1}] = ")
    assert wrong_step != text
    source.write_text(wrong_step)
    assert eva.analyse(task, program)[1]


# -- what must be refused ------------------------------------------------------------------------------------

WRONG = {
    "a variable": ("symbols", "int noslip_counter_f = 0;", "noslip_counter_f"),
    "a static variable": (
        "symbols",
        "int noslip_count_f(void);\nint noslip_count_f(void) { static int count; return count++; }",
        "writable data",
    ),
    "the heap": (
        "symbols",
        "void *malloc(unsigned long size);\nvoid *noslip_f(void);\nvoid *noslip_f(void) { return "
        "malloc(9); }",
        "malloc",
    ),
    "libm": (
        "symbols-m4f",
        "float sinf(float);\nfloat noslip_f(float x);\nfloat noslip_f(float x) { return sinf(x); }",
        "sinf",
    ),
    "double in float": (
        "symbols-m4f",
        "float noslip_f(float x);\nfloat noslip_f(float x) { return (float)(x * 0.1); }",
        "__aeabi_dmul",
    ),
    "a struct that is copied by a call": (
        "symbols-m4f",
        "typedef struct { float x[64]; } noslip_big;\nvoid noslip_f(noslip_big *a, const noslip_big *b);\n"
        "void noslip_f(noslip_big *a, const noslip_big *b) { *a = *b; }",
        "memcpy",
    ),
    "double in float, warned of": (
        "warnings-m4f",
        "float noslip_f(float x);\nfloat noslip_f(float x) { return (float)(x * 0.1); }",
        "double-promotion",
    ),
    "recursion": (
        "stack-m4f",
        "int noslip_path_a_f(int n);\nint noslip_path_b_f(int n);\n__attribute__((noinline)) int "
        "noslip_path_b_f(int n) { return n ? noslip_path_a_f(n - 1) * 3 + n : 0; "
        "}\n__attribute__((noinline)) int noslip_path_a_f(int n) { return n ? noslip_path_b_f(n / 2) + n : "
        "0; }",
        "recursion",
    ),
    "a large frame": (
        "stack-m4f",
        "int noslip_path_f(int n);\nint noslip_path_f(int n) { volatile int a[99]; a[n] = n; return a[n / "
        "2]; }",
        "more than 384",
    ),
    "a frame that grows": (
        "stack-m4f",
        "int noslip_path_f(int n);\nint noslip_path_f(int n) { volatile int a[n]; a[n - 1] = n; return a[n / "
        "2]; }",
        "as it runs",
    ),
    "a comparison for equality": (
        "warnings",
        "int noslip_f(float x);\nint noslip_f(float x) { return x == 1.0f; }",
        "float-equal",
    ),
    "a null pointer followed": (
        "warnings",
        "int noslip_f(int x);\nint noslip_f(int x) { int *p = 0; if (x > 3) { p = &x; } return *p; }",
        "null",
    ),
    "an integer division made a float": (
        "clang-tidy",
        "float noslip_f(int x);\nfloat noslip_f(int x) { return (float)(x / 2) + x / 3; }",
        "integer-division",
    ),
    "goto": (
        "misra",
        "int noslip_f(int x);\nint noslip_f(int x) { again: if (x > 0) { x--; goto again; } return x; }",
        "15.1",
    ),
}


def only(text: str, folder: Path) -> Task:
    """A task that finds this C and nothing else."""
    for name in ("runtime_c", "generated/labmate", "firmware/boards"):
        (folder / "root" / name).mkdir(parents=True)
    (folder / "root/runtime_c/noslip_wrong_f.c").write_text(text + "\n")
    for name in ("firmware/boards/string.c", "firmware/boards/string.h", ".clang-tidy"):
        shutil.copy(ROOT / name, folder / "root" / name)
    return Task(folder, root=folder / "root")


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_found(wrong, tmp_path):
    name, text, message = WRONG[wrong]
    try:
        CHECKS[name](only(text, tmp_path))
    except Missing as missing:
        pytest.skip(str(missing))
    except (Failed, RuntimeError) as failed:
        assert message in str(failed), failed
    else:
        pytest.fail(f"{name} accepts {wrong}")


def changed(folder: Path, file: str, was: str, now: str, laws: str | None = "") -> Task:
    """A task on a copy of the C in which one thing is changed, with only the law of that name; None:
    with all."""
    for name in ("runtime_c", "generated", "tests/c", "firmware/boards", "checks/bench/target"):
        shutil.copytree(ROOT / name, folder / "root" / name)
    for path in (folder / "root/generated/labmate").rglob("labmate_*"):
        follower = "_follower" in path.name or "_telemetry" in path.name
        whole = "_type_" in path.name or (follower and laws != "labmate_type_iv_segment")
        if (
            laws is not None
            and whole
            and not path.name.startswith((f"{laws}.", f"{laws}_f.", f"{laws}_steps"))
        ):
            path.unlink()
    path = folder / "root" / file
    text = path.read_text()
    assert was in text
    path.write_text(text.replace(was, now))
    return Task(folder, root=folder / "root", short=True)


with_eva = pytest.mark.skipif(shutil.which("frama-c") is None, reason="frama-c not installed")

EVA_FINDS = {
    "an angle beyond integers": (
        (
            "noslip_angle.inc",
            "!(NOSLIP_NAME(noslip_angle_ok)(desired) &&",
            "(NOSLIP_NAME(noslip_abs)(desired) < 0 &&",
        ),
        "overflow in conversion",
    ),
    "something added beyond its limit": (
        ("noslip_real.h", "(x) && x >= -limit && x <= limit;", "(x) && x >= -limit;"),
        "assertion got status",
    ),
    "a write where none may be": (
        (
            "noslip_odometry.inc",
            "self->last = counter;\n    *angle",
            "self->last = counter;\n    self->mask = 0;\n    *angle",
        ),
        "writes to",
    ),
}


@pytest.mark.parametrize("wrong", EVA_FINDS)
@with_eva
def test_eva_finds(wrong, tmp_path):
    (file, was, now), message = EVA_FINDS[wrong]
    _, lines = eva.analyse(
        changed(tmp_path, f"runtime_c/{file}", was, now), eva.AnalysedProgram("runtime", "float")
    )
    assert any(message in line for line in lines), lines


EVA_FINDS_IN_DRIVES = {
    "a command beyond its limit": (
        ("noslip_motor.inc", "within)(current, self->current)", "is_finite)(current)"),
        "assertion got status",
    ),
    "a stop that ends by itself": (
        ("noslip_watchdog.c", " || self->state == NOSLIP_WATCHDOG_STOP", ""),
        "assertion got status",
    ),
    "a count that overflows": (
        ("noslip_watchdog.c", "stood >= self->settings.stuck", "settings.stuck < 0"),
        "overflow",
    ),
}


@pytest.mark.parametrize("wrong", EVA_FINDS_IN_DRIVES)
@with_eva
def test_eva_finds_in_drives(wrong, tmp_path):
    (file, was, now), message = EVA_FINDS_IN_DRIVES[wrong]
    _, lines = eva.analyse(
        changed(tmp_path, f"runtime_c/{file}", was, now), eva.AnalysedProgram("drives", "float")
    )
    assert any(message in line for line in lines), lines


@pytest.mark.nightly
@with_eva
def test_eva_finds_in_balance(tmp_path):
    """A number of a state that there is not."""
    task = changed(tmp_path, "runtime_c/noslip_balance.inc", "options->y < options->states && ", "")
    _, lines = eva.analyse(task, eva.AnalysedProgram("balance", "float"))
    assert any("out of bounds read" in line for line in lines), lines


@with_eva
def test_eva_proves_a_state_feedback_and_finds_what_is_wrong(tmp_path):
    """The generated header of the balancer's; planted are an input beyond its limit,
    and a state more than there are gains."""
    task = Task(tmp_path / "right", feedbacks=FEEDBACKS)
    (name,) = task.feedback_names
    program = eva.AnalysedProgram("feedback", "float", name)
    proved, wrong = eva.analyse(task, program)
    assert proved > 5 and not wrong
    clip = "tau[k] = NOSLIP_NAME(noslip_clip)(input, limit);"
    unlimited = changed(tmp_path / "runtime", "runtime_c/noslip_balance.inc", clip, "tau[k] = input;")
    lines = eva.analyse(replace(unlimited, feedbacks=FEEDBACKS), program)[1]
    assert any("assertion got status" in line for line in lines)
    header = task.law_file(f"{name}.h")
    text = header.read_text()
    header.write_text(text.replace("options.states = 9;", "options.states = 10;"))
    assert header.read_text() != text
    assert any("out of bounds" in line for line in eva.analyse(task, program)[1])


EVA_FINDS_IN_GRIP = {
    "a force across that does not count": ("noslip_grip.inc", " - ground[1] * ground[1] >= 0", " >= 0"),
    "friction that is not checked": (
        "noslip_grip.inc",
        " - ground[1] * ground[1] >= 0",
        " - ground[1] * ground[1] >= 0 || 1",
    ),
    "an input beyond its limit": (
        "noslip_grip.inc",
        "inputs[i] = inputs[i] > 0 ? limits[i] : -limits[i];",
        "finite = 1;",
    ),
    "more believed than there may be": ("noslip_grip.inc", "mu = mu < earned->most ? mu : earned->most;", ""),
    "a contact that is not checked": ("law", " && noslip_holds_f(&ground[4], &self->grip) ? ", " ? "),
}


@pytest.mark.nightly
@pytest.mark.parametrize("wrong", EVA_FINDS_IN_GRIP)
@with_eva
def test_eva_finds_in_grip(wrong, tmp_path):
    file, was, now = EVA_FINDS_IN_GRIP[wrong]
    path = "generated/labmate/labmate_type_i_f.c" if file == "law" else f"runtime_c/{file}"
    task = changed(tmp_path, path, was, now, "labmate_type_i")
    _, lines = eva.analyse(task, eva.AnalysedProgram("grip", "float", "labmate_type_i"))
    assert any("assertion got status" in line for line in lines), lines


EVA_FINDS_IN_FRAMES = {
    "an image longer than its memory": ("noslip_image.c", " || length > size", ""),
    "more segments than places": ("noslip_image.c", " || *count > (uint32_t)most ?", " ?"),
    "a byte behind the ring": (
        "noslip_telemetry.c",
        "ring[self->at & self->to->mask] = byte",
        "ring[self->at] = byte",
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("wrong", EVA_FINDS_IN_FRAMES)
@with_eva
def test_eva_finds_in_frames(wrong, tmp_path):
    file, was, now = EVA_FINDS_IN_FRAMES[wrong]
    task = changed(tmp_path, f"runtime_c/{file}", was, now, "labmate_type_iv_segment")
    _, lines = eva.analyse(task, eva.AnalysedProgram("telemetry", "float"))
    assert any("out of bounds" in line for line in lines), lines


FOLLOWER = "generated/labmate/labmate_follower_f.c"
EVA_FINDS_IN_THE_FOLLOWER = {
    "a command that stays after a stop": (
        "        command[0] = 0;\n        command[1] = 0;\n    }\n    return status;",
        "    }\n    return status;",
    ),
    "a torque of no law": ("self->torque[0] = torque[0];", "self->torque[0] = self->rate[0];"),
    "a time that may be infinite": ("if (noslip_is_positive_f(dt) && dt <=", "if (dt > 0 || dt <="),
    "a stop that is good": (
        "self->watchdog.status : NOSLIP_NOT_READY;",
        "self->watchdog.status : NOSLIP_OK;",
    ),
    "a follower that is ready too early": (
        "    self->ready = 0;\n    if (config == NULL)",
        "    self->ready = NOSLIP_READY;\n    if (config == NULL)",
    ),
    "a config that is changed": (
        "    self->waited = 0;\n    if (noslip_abs_f(odometry",
        "    ((labmate_follower_config_f *)self->config)->period = 1;\n    if (noslip_abs_f(odometry",
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("wrong", EVA_FINDS_IN_THE_FOLLOWER)
@with_eva
def test_eva_finds_in_the_follower(wrong, tmp_path):
    law = "labmate_type_iv_segment"
    task = changed(tmp_path, FOLLOWER, *EVA_FINDS_IN_THE_FOLLOWER[wrong], law)
    _, lines = eva.analyse(task, eva.AnalysedProgram("follower", "float", law))
    assert any(
        word in line
        for line in lines
        for word in ("assertion got status", "writes to", "non-finite", "overflow")
    ), lines


SEGMENTS = ("#define SEGMENTS 3", "#define SEGMENTS 1")  # of the paths analysed: with one it is quicker


def programs(folder: Path, file: str, was: str, now: str) -> Path:
    """A copy of the programs that EVA analyses, in which one thing is changed."""
    shutil.copytree(eva.PROGRAMS, folder)
    text = (folder / file).read_text()
    assert was in text
    (folder / file).write_text(text.replace(was, now).replace(*SEGMENTS))
    return folder


@pytest.mark.nightly
@with_eva
def test_eva_finds_in_a_path(tmp_path, monkeypatch):
    """After the last segment another one is looked for."""
    task = changed(
        tmp_path, "runtime_c/noslip_path_code.inc", "segment + 1 < self->count", "segment + 1 <= self->count"
    )
    monkeypatch.setattr(eva, "PROGRAMS", programs(tmp_path / "eva", "path.c", *SEGMENTS))
    _, lines = eva.analyse(task, eva.AnalysedProgram("path", "float"))
    assert any("out of bounds read" in line for line in lines), lines


VACUOUS = {  # file of c/eva/ and what is changed in it, the program, and the place that is then not reached
    "no step is checked": (
        ("law.c", "        check_step(", "        (void)follow; if (0) check_step("),
        "law",
        "step_good",
    ),
    "no law is ready": (
        ("law.c", "    law.on_error = on_error;", "    law.on_error = on_error;\n    law.ready = 0;"),
        "law",
        "step_good",
    ),
    "no other function is checked": (
        ("law.c", "    check_functions();\n    REACHED", "    REACHED"),
        "law",
        "evaluate_good",
    ),
    "no encoder is checked": (
        ("runtime.c", "    check_encoder();\n    check_integral", "    check_integral"),
        "runtime",
        "read_good",
    ),
    "no odometry is ready": (
        ("runtime.c", "    ANY(*self);\n", "    ANY(*self);\n    self->ready = self->steady = 0;\n"),
        "runtime",
        "move_good",
    ),
    "no update of a path is checked": (
        ("path.c", "segment = 0; segment < count;", "segment = 0; segment < 0;"),
        "path",
        "update_good",
    ),
}


@pytest.mark.parametrize(
    "wrong",
    [
        wrong if wrong == "no law is ready" else pytest.param(wrong, marks=pytest.mark.nightly)
        for wrong in VACUOUS
    ],
)
@with_eva
def test_eva_does_not_hold_vacuously(wrong, tmp_path, monkeypatch):
    """Where what is to be shown is not reached, nothing is shown of it."""
    (file, was, now), source, place = VACUOUS[wrong]
    monkeypatch.setattr(eva, "PROGRAMS", programs(tmp_path / "eva", file, was, now))
    law = "labmate_type_i" if source == "law" else ""
    _, lines = eva.analyse(Task(tmp_path, short=True), eva.AnalysedProgram(source, "float", law))
    assert any(line.endswith(f"{place} is not reached") for line in lines), lines


def test_bits_of_what_is_analysed_are_compared(tmp_path):
    """A form for Frama-C that is not the one that ships."""
    need("gcc")
    was = "noslip_is_finite_f(x) && x >= -limit"
    task = changed(
        tmp_path, "runtime_c/noslip_real.h", was, "noslip_is_finite_f(x) && x >= -1.0f", "labmate_type"
    )
    with pytest.raises(Failed, match="shipped"):
        eva.same_bits(task)


GROWN = (
    "    self->ready = 0;\n",
    "    self->ready = 0;\n    self->held[0] = params == NULL ? 0 : params->r * params->b / params->d;\n",
)


@pytest.mark.parametrize("name", ["sizes", "sizes-m4f"])
def test_a_law_that_grows_is_found(name, tmp_path):
    task = changed(tmp_path, "generated/labmate/labmate_type_i_f.c", *GROWN, "labmate_type_i")
    try:
        summary = CHECKS[name](task)
    except Missing as missing:
        pytest.skip(str(missing))
    except Failed as failed:
        assert "labmate_type_i_f text" in str(failed)
    else:
        assert summary.startswith("not compared") or "not compared" in summary, summary


FOLLOW = "generated/labmate/labmate_type_iv_segment_f.c"
FOLLOWED = "labmate_type_iv_segment_follow_f_law(self, foot, state, reference, made);"
LANE = "generated/labmate/lanes/labmate_type_i_steps.c"
SEEDED_FIND = {
    "an answer beyond its limit": (
        ("runtime_c/noslip_real.h", "(x) <= limit;", "(x) <= limit * 1.001;", "labmate_type_i"),
        r"not (isfinite|options.limit)",
    ),
    "a lane that is not the step": (
        (
            LANE,
            "inputs[0][i] = fine ? made[0]",
            "inputs[0][i] = fine ? made[0] * (1 + 1e-15)",
            "labmate_type_i",
        ),
        r"not k % LANES != lane",
    ),
    "a position that follow reads": (
        (FOLLOW, FOLLOWED, f"{FOLLOWED} made[0] += state->phi;", "labmate_type_iv_segment"),
        "not status == STEP",
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("wrong", SEEDED_FIND)
def test_seeded_numbers_find(wrong, tmp_path):
    change, message = SEEDED_FIND[wrong]
    task = changed(tmp_path, *change)
    with pytest.raises(Failed, match=message):
        try:
            fuzz.sanitizers(task)
        except Missing as missing:
            pytest.skip(str(missing))


SLOWER = (
    "            self->held[1] = made[1];\n",
    "            self->held[1] = made[0] * made[1] + made[1];\n",
)
FUZZ_FINDS = {  # a change of the runtime, and what is told
    "an angle beyond integers": (
        EVA_FINDS["an angle beyond integers"][0],
        "outside the range of representable values",
    ),
    "an integral beyond its limit": (
        ("noslip_integral.inc", "self->added = added;\n    }", "self->added = 2 * added;\n    }"),
        r"not isfinite\(added\)",
    ),
    "an estimate beyond its limit": (
        (
            "noslip_disturbance.inc",
            "estimate = NOSLIP_NAME(noslip_clip)(found, self->limit);",
            "estimate = found;",
        ),
        r"not !ready \|\| limit == 0 \|\| fabs\(\(double\)self.estimate",
    ),
    "a command that changes too fast": (
        ("noslip_velocity.inc", "if (!(most > 1)) {", "if (!(most > 3)) {"),
        r"not fabs\(\(double\)command",
    ),
    "a speed that overflows, by an input of the corpus": (
        (
            "noslip_path_code.inc",
            "self->braking_distance = self->braking_distance < largest ? self->braking_distance : largest;",
            "(void)largest;",
        ),
        "fuzz_is_guide",
    ),
}


def test_what_the_night_changes_is_in_the_c():
    """Each of these defects is planted in text that is there."""
    tables = (EVA_FINDS, EVA_FINDS_IN_DRIVES, FUZZ_FINDS)
    changes = [
        *(change for table in tables for change, _ in table.values()),
        *EVA_FINDS_IN_GRIP.values(),
        *EVA_FINDS_IN_FRAMES.values(),
    ]
    law = "generated/labmate/labmate_type_i_f.c"
    missing = [
        (file, was)
        for file, was, _ in changes
        if was not in (ROOT / (law if file == "law" else f"runtime_c/{file}")).read_text()
    ]
    missing += [
        (FOLLOWER, was)
        for was, _ in EVA_FINDS_IN_THE_FOLLOWER.values()
        if was not in (ROOT / FOLLOWER).read_text()
    ]
    assert len(changes) > 15 and missing == []


@pytest.mark.parametrize("wrong", FUZZ_FINDS)
def test_fuzzing_finds(wrong, tmp_path, monkeypatch):
    """In as many runs as `make guarantees` has; most end after some thousand."""
    monkeypatch.setitem(fuzz.RUNS, True, fuzz.RUNS[False])
    (file, was, now), message = FUZZ_FINDS[wrong]
    task = changed(tmp_path, f"runtime_c/{file}", was, now)
    with pytest.raises(Failed, match=message):
        try:
            fuzz.fuzz(task)
        except Missing as missing:
            pytest.skip(str(missing))


def test_every_input_of_the_corpus_is_used(tmp_path):
    """Each is for a function of the table; another table leaves it with its function."""
    names = fuzz._functions(Task(tmp_path))
    lines = fuzz.CORPUS.read_text().splitlines()
    assert {line.split()[0] for line in lines} <= set(names)
    some = [*reversed(names), "new"]
    inputs = [path.read_bytes() for path in fuzz._unpacked(tmp_path, some).iterdir()]
    assert sorted(fuzz._packed(content, some) for content in inputs) == sorted(lines)


@pytest.mark.nightly
def test_a_law_that_takes_longer_is_found(tmp_path):
    """One operation more in each good step."""
    task = changed(tmp_path, "generated/labmate/labmate_type_i_f.c", *SLOWER, "labmate_type_i")
    try:
        summary = CHECKS["instructions-m4f"](task)
    except Missing as missing:
        pytest.skip(str(missing))
    except Failed as failed:
        assert "labmate_type_i_f most good" in str(failed)
    else:
        assert "not compared" in summary, summary


# -- the budget ----------------------------------------------------------------------------------------------


@pytest.fixture
def compare(monkeypatch, tmp_path):
    """Compares numbers of one module with a budget that a first call has made."""
    monkeypatch.setattr(budget, "FILE", tmp_path / "budget.json")

    def compare(numbers: dict[str, int], target: Machine = HOST, update: bool = False) -> str:
        return budget.compare(Task(tmp_path, update=update), target, {"law": numbers})

    need(HOST.prefix + "gcc")
    compare({"text": 100, "stack": 20}, update=True)
    return compare


def test_budget(compare):
    assert compare({"text": 100, "stack": 20}) == compare({"text": 100}) == "as budgeted"
    assert compare({"text": 90, "stack": 20}) == "law text: 90, -10"
    with pytest.raises(Failed, match=r"law text: 101, \+1"):
        compare({"text": 101, "stack": 20})
    with pytest.raises(Failed, match="not in the budget"):
        compare({"data": 0})
    compare({"text": 101}, update=True)
    assert compare({"text": 101, "stack": 20}) == "as budgeted"


def test_budget_of_another_compiler_is_not_compared(compare, monkeypatch):
    monkeypatch.setattr(Machine, "version", "gcc 99.0")
    assert compare({"text": 1000, "stack": 20}).startswith("not compared: gcc 99.0, the budget is of gcc")


def test_the_page_has_the_budgeted_numbers():
    page = instructions.PAGE.read_text()
    assert instructions.with_table(page, budget.FILE.read_text()) == page
    assert (
        instructions.with_table(page, budget.FILE.read_text().replace('"most good": 99', '"most good": 98'))
        != page
    )


def test_the_table_of_timing_has_the_budgeted_numbers():
    """The instructions in docs/firmware.md, and cycles that are no fewer than a processor can take for
    them."""
    import json
    import re

    budgets, page = json.loads(budget.FILE.read_text()), (ROOT / timing.PAGE).read_text()
    table = re.findall(r"^\| `(\w+)` \| (\d+.*) \|$", page[page.index(timing.HEAD) :], re.M)
    rows = {entry: [int(cell) for cell in cells.split(" | ")] for entry, cells in table}
    found = {}
    for k, (name, (machine, _)) in enumerate(timing.MODELS.items()):
        counted = {entry: (row[2 * k], row[2 * k + 1]) for entry, row in rows.items()}
        assert {entry: most for entry, (most, _) in counted.items()} == budgets[machine.name]["modules"][
            "timing"
        ]
        assert all(most < cycles < 5 * most for most, cycles in counted.values())
        found[name] = counted
    stack = {entry: row[-1] for entry, row in rows.items()}
    assert (
        stack["labmate_follower_tick"]
        == budgets[M4F.name]["modules"]["runtime_f"]["stack labmate_follower_tick"]
    )
    assert timing.with_table(page, found, stack) == page
    assert timing.with_table(page, found, stack | {"labmate_follower_tick": 1}) != page


def test_committed_budget_is_that_of_the_committed_c():
    """Every law and the path, on both targets, and what the text of the guarantees speaks of."""
    import json

    budgets = json.loads(budget.FILE.read_text())
    names = {law + suffix for law in Task(Path()).laws for suffix in ("", "_f")} | {
        "noslip_path",
        "noslip_path_f",
    }
    assert names <= set(budgets[HOST.name]["modules"]) if HOST.name in budgets else True
    bare = budgets[M4F.name]["modules"]
    for name in (name for name in names if name.endswith("_f")):
        assert bare[name]["data"] == bare[name]["bss"] == 0 < bare[name]["struct"]
    for law in Task(Path()).laws:
        assert (
            max(value for key, value in bare[f"{law}_f"].items() if key.startswith("stack"))
            <= memory.MOST_STACK
        )
