"""Which parameters of tests `make test` leaves to `make nightly`: those of long tests that have siblings with the same check.

A pattern is looked for in what comes after `::` in a test's name. Tests that are long as a whole carry the marker `nightly` where
they are defined, and have a smaller version beside them.
"""

import re
from collections.abc import Iterable

NIGHTLY = {
    "test_analyse": (r"an_arc_is_judged_as_its_circle_and_as_it_runs\[(?!-1\.04)",),
    "test_battery": (
        r"test_battery\[(car type_i|(tricycle|rolling_disk) type_iv_circle|slope_platform type_i|mobile_manipulator end_point)\]",
        r"test_battery\[(tractor_trailer:4 type_i|four_wheel type_iv_circle)\]",
        r"passes_its_own_test\[(tractor_trailer|ball_plate)-generic\]",
    ),
    "test_bits": (r"test_bits\[(cortex-m4f (clang|arm-none-eabi-gcc -O2 )|.* clang -O0|.*-mavx2)",),
    "test_cli": (r"leaves_nothing\[(import-(2|40|600)-2|import-(9|150)-15|open-400-15|os.mkdir-2-2|os.rename-1-15)\]",),
    "test_contact": (r"affine_in_what_is_wanted\[(tractor_trailer[01]|mobile_manipulator)\]",),
    "test_dialects": (r"on_arm\[-O2-m7\]", r"passes_on_arm\[-std=gnu17 -O3\]"),
    "test_evaluate": (r"many_random_states\[(type_iii?|type_iv_(line|circle|ellipse))\]",),
    "test_extension": (r"that_were_placed\[(train|arm|car-casadi|path-casadi)", r"the_c_is_the_model\[type_i_offset"),
    "test_figures": (r"every_claim_\w+\[(8b|9b|10|11|12|14|16|waypoints|rates|ellipse|limits|cusp)\]",),
    "test_figures_more": (r"every_claim_can_fail\[(10|11|12|14|16|limits|waypoints|rates)\]",),
    "test_firmware": (r"image_arrives\[(cortex-m4f-clang|netduinoplus2-gcc|rv32imafc-gcc)\]",),
    "test_functions": (
        r"in_a_force\[(acos|sinh|tan|exp|atan|tanh|equal|either)\]",
        r"in_outputs\[(atan|fmax|hypot|asin|fabs|exp)\]",
        r"outside_a_domain_is_a_status\[within.*-float\]",
    ),
    "test_import": (r"\[two_trailers\]",),
    "test_guidance": (r"starts_on_the_circle_are_judged_as_they_run\[(-0\.|-1\.57|1\.04|1\.57|2|3)",),
    "test_large": (
        r"c_is_the_model\[(arm_5-(double|float)|arm_4-double|manipulator-double)\]",
        r"(singular_exactly|what_the_outer_loop_asks)\[arm_5\]",
    ),
    "test_mutated": (r"used_or_refused\[designed\]",),
    "test_package": (r"readme_robot\[float", r"export_builds_as_it_is\[gcc-selection0\]"),
    "test_pil": (r"test_loop\[rv32-(line|circle)\]", r"interrupt_leaves_nothing\[rv32\]"),
    "test_planning": (
        r"of_a_function\[(ellipse|spiral|wiggles)-0\.002\]",
        r"through_waypoints\[[3-8]-",
        r"full_turn\[(0\.1|20\.0)-reeds_shepp\]",
    ),
    "test_project": (r"cmake_runs_the_selftest_where_it_belongs\[(rv32|generic)\]", r"users_flags_alone\[(rv32|generic)\]"),
    "test_robot_figures": (r"claims_hold_and_can_fail\[(mobile_manipulator|tractor_trailer|slope_platform)\]",),
    "test_shape": (r"enclosed_too\[tractor_trailer:3\]",),
    "test_robots": (r"analyse_answers_as_json\[mobile_manipulator\]", r"what_brackets_give\[(car|tricycle|slope_platform)\]"),
    "test_runtime": (r"from_the_flow_of_data\[-(O1|Os)\]",),
    "test_tracking": (r"from_beginning_to_end\[[2-5]\d-", r"double_against_the_reference\[[2-5]\d"),
}


def is_nightly(file: str, name: str) -> bool:
    """Is a test (its name after `::`) of a file (without `.py`) one of the above?"""
    return any(re.search(pattern, name) for pattern in NIGHTLY.get(file, ()))


def faults(tests: Iterable[tuple[str, str]]) -> list[str]:
    """Patterns that fit no test, or leave none of a function's tests in `make test`; `tests`: all (file, name) of some files."""
    tests, found = list(tests), []
    for file in sorted({file for file, _ in tests} & NIGHTLY.keys()):
        names = [name for each, name in tests if each == file]
        found += [f"{file}: no test fits {p}" for p in NIGHTLY[file] if not any(re.search(p, name) for name in names)]
        kept = {name.partition("[")[0] for name in names if not is_nightly(file, name)}
        found += [f"{file}: no {name} is left" for name in sorted({name.partition("[")[0] for name in names} - kept)]
    return found
