"""C shared by all laws of a robot: parameters, state, options, and their checks."""

from collections.abc import Sequence

from ...model.mechanism import Mechanism, Quantity
from ...model.reduction import ReducedSystem
from ...readers.templates import render
from ..derivation.grip import can_grip
from .layout import c_linkage, comment, guard_name, table, version_check
from .scalar import Scalar


def struct(name: str, about: str, members: Sequence[tuple[str, str]]) -> str:
    """Return the typedef of a struct; `members`: declarations and comments. C has no struct without
    members."""
    members = members or [("int nothing;", "not used")]
    return "\n".join([f"/* {about} */", f"typedef struct {name} {{", *table(members), f"}} {name};"])


def fields(scalar: Scalar, quantities: Sequence[Quantity]) -> list[tuple[str, str]]:
    """Return the members of a struct for quantities, with unit and meaning."""
    return [(f"{scalar.real} {q.in_c};", f"{q.unit}: {q.about}" if q.about else q.unit) for q in quantities]


def refuse_parameters(scalar: Scalar, group: str, quantities: Sequence[Quantity]) -> str:
    """Return the C condition under which a group of parameters is invalid."""
    finite, positive = scalar.name("noslip_is_finite"), scalar.name("noslip_is_positive")
    signs = {
        "positive": f"!{positive}({{0}})",
        "nonnegative": f"!({finite}({{0}}) && {{0}} >= 0)",
        "any": f"!{finite}({{0}})",
    }
    tests = [signs[q.sign].format(f"{group}->{q.in_c}") for q in quantities]
    return " ||\n        ".join(tests) or "0"


def written_once(scalar: Scalar, call: str, pieces: Sequence[tuple[str, str, int]]) -> list[str]:
    """Return the statements that end an entry point with the `status` of its checks: `call` computes the
    values, which are written if they are valid and finite; otherwise zeros are. `pieces` are the local array
    and the caller's with their length; if the two are the same, the call writes the values itself."""
    finite = " && ".join(f"{scalar.name('noslip_all_finite')}({local}, {size})" for local, _, size in pieces)
    return [
        "if (status == NOSLIP_OK) {",
        f"    status = {call};",
        f"    if (status == NOSLIP_OK && !({finite})) {{",
        "        status = NOSLIP_NONFINITE;",
        "    }",
        "    if (status == NOSLIP_OK) {",
        *(
            f"        {scalar.name('noslip_write')}({local}, {place}, {size});"
            for local, place, size in pieces
            if local != place
        ),
        "        return NOSLIP_OK;",
        "    }",
        "}",
        *(f"{scalar.name('noslip_write_zeros')}({place}, {size});" for _, place, size in pieces),
        "return status;",
    ]


def robot_declarations(system: ReducedSystem, scalar: Scalar) -> str:
    """Return types and prototypes, without preprocessor directives."""
    mechanism = system.mechanism
    name, real, own = mechanism.name, scalar.real, scalar.name
    inputs = ", ".join(f"{q.name} ({q.unit})" for q in mechanism.inputs)
    count = len(mechanism.inputs)
    params, state, options = own(f"{name}_params"), own(f"{name}_state"), own(f"{name}_options")
    option_members = [
        (f"{real} limit[{count}];", f"largest absolute value of {inputs}; 0: no limit"),
        ("noslip_on_error on_error;", "NOSLIP_ZERO (0) or NOSLIP_HOLD"),
        (
            "noslip_on_limit on_limit;",
            "NOSLIP_CUT (0) or, for laws with exactly one output of relative degree 1 (Type IV), NOSLIP_SLOW"
            + ("; NOSLIP_GRIP" if can_grip(system) else ""),
        ),
        *(
            [(f"{own('noslip_friction')} friction;", "the floor, for NOSLIP_GRIP")]
            if can_grip(system)
            else []
        ),
    ]
    return "\n\n".join(
        [
            struct(params, "Physical parameters, SI.", fields(scalar, mechanism.parameters)),
            struct(state, "State: coordinates and quasi-velocities, SI.", fields(scalar, system.state)),
            struct(
                options, "Options of a step; all zero means no limits, and zeros on an error.", option_members
            ),
            "\n".join(
                [
                    "/* The default parameters, those of the model. */",
                    f"int {own(name + '_default_params')}({params} *params);",
                    "",
                    "/* NOSLIP_BAD_PARAMETER unless every parameter is finite and has the sign it must have. "
                    "*/",
                    f"int {own(name + '_check_params')}(const {params} *params);",
                    "",
                    "/* NOSLIP_NONFINITE unless every part of the state is finite. */",
                    f"int {own(name + '_check_state')}(const {state} *state);",
                ]
            ),
        ]
    )


def robot_header(system: ReducedSystem, scalar: Scalar, banner: Sequence[str]) -> str:
    """Return the header of a robot."""
    mechanism = system.mechanism
    file_name = f"{scalar.name(mechanism.name)}.h"
    guard = guard_name(file_name)
    about = [f"{file_name} - {mechanism.about}", *banner, "", *_equations(mechanism)]
    return "\n".join(
        [
            comment(about),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f'#include "noslip_{"grip" if can_grip(system) else "controller"}.h"',
            "",
            *version_check(file_name),
            "",
            *c_linkage(robot_declarations(system, scalar)),
            "",
            "#endif",
            "",
        ]
    )


def robot_source(system: ReducedSystem, scalar: Scalar, banner: Sequence[str]) -> str:
    """Return the source of a robot."""
    mechanism, own = system.mechanism, scalar.name
    return render(
        __file__,
        "robot.c",
        robot=mechanism,
        own=own,
        literal=scalar.literal,
        head=comment([f"{own(mechanism.name)}.c - parameters and state of {mechanism.name}", *banner]),
        refused=refuse_parameters(scalar, "params", mechanism.parameters),
        finite=" &&\n        ".join(f"{own('noslip_is_finite')}(state->{q.in_c})" for q in system.state),
    )


def _equations(mechanism: Mechanism) -> list[str]:
    n, m, r = len(mechanism.coordinates), len(mechanism.constraint_names), len(mechanism.inputs)
    return [
        f"n = {n} coordinates, m = {m} rolling constraints, r = {r} inputs, n - m = {n - m} "
        "quasi-velocities.",
        "Constraints A(q) qdot = 0 (2): " + "; ".join(mechanism.constraint_names) + ".",
        "Equation numbers (..) are those of Sarkar, Yun and Kumar, MS-CIS-92-44 (1992).",
        "SI units. Angles in rad, counterclockwise positive. Inputs do the power input * velocity of what "
        "they drive.",
    ]
