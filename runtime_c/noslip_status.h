/*
 * noslip_status.h - the status that every function returns: zero or positive on success, negative on an error.
 *
 * Outputs. Every function writes each number of its outputs once, at the end, after all inputs have been read, with its final
 * value: within its limit, zero or held on an error, never NaN. If the processor writes a number in one access (a double on a
 * 32-bit processor takes two), another task or an interrupt reads the value of the previous call or of this one. Two numbers of
 * one output may then belong to different calls; use a lock where they must be consistent. An output may overlap with an input,
 * for example tau with the state, but not with `self` or another output. `self` must be used by one task at a time, including
 * fields that are read directly, such as guide in noslip_path and pose in noslip_odometry. Exceptions: noslip_solve.h works in
 * place, and evaluate, which is for diagnosis and not for control, writes while it computes.
 */
#ifndef NOSLIP_STATUS_H
#define NOSLIP_STATUS_H

#include "noslip_version.h"

/* Before a function: the compiler warns where its status is ignored. GCC's warning is not silenced by a cast to void. */
#if defined(__cplusplus) && __cplusplus >= 201703L
#define NOSLIP_NODISCARD [[nodiscard]]
#elif defined(__GNUC__)
#define NOSLIP_NODISCARD __attribute__((warn_unused_result))
#else
#define NOSLIP_NODISCARD
#endif

/* The last value of each enum type, ..._AS_INT, is not a valid choice: it makes the type an int on every compiler. */

#ifdef __cplusplus
extern "C" {
#endif

enum {
    NOSLIP_OK = 0,
    NOSLIP_SATURATED = 1,      /* success, but an input was limited */
    NOSLIP_ARRIVED = 2,        /* success, and the end of the path is reached */
    NOSLIP_GRIP_LIMITED = 3,       /* success, but inputs were changed so that the wheels roll (on_limit = NOSLIP_GRIP) */
    NOSLIP_WILL_SLIP = 4,      /* success, but friction is not enough even for coasting: the wheels will slip */
    NOSLIP_SLIPPING = 5,       /* success, but the wheels slip, or did so a moment ago: see noslip_slip.h */
    NOSLIP_REJECTED = 6,       /* success, but a measurement was not used: its innovation is too large */
    NOSLIP_NULL = -1,          /* a required pointer is null */
    NOSLIP_NONFINITE = -2,     /* a state, reference or result is infinite or NaN */
    NOSLIP_RANGE = -3,         /* an angle exceeds NOSLIP_ANGLE_MAX (double) or NOSLIP_ANGLE_MAX_F (float) */
    NOSLIP_BAD_PARAMETER = -4, /* a parameter, gain or option is not finite or has the wrong sign */
    NOSLIP_SINGULAR = -5,      /* the decoupling matrix is singular, or the output is not differentiable */
    NOSLIP_NOT_READY = -6,     /* init was not called, or failed */
    NOSLIP_BAD_PATH = -7,      /* the vehicle cannot follow the path: see its fault */
    NOSLIP_UNSTABLE = -8,      /* forward speed and L + d have opposite signs: the heading would diverge */
    NOSLIP_ASTRAY = -9,        /* the vehicle is farther from its path than it may be */
    NOSLIP_DAMAGED = -10,      /* bytes are not those that were saved: their CRC is wrong */
    NOSLIP_OTHER_VERSION = -11, /* saved in another format, with other fields or in the other scalar */
    NOSLIP_OTHER_MODEL = -12,  /* saved for another robot or law */
    NOSLIP_FULL = -13,         /* the caller's memory has no room */
    NOSLIP_DIVERGED = -14      /* the estimate disagrees with measurement after measurement */
};

/* What a controller returns on an error. */
typedef enum noslip_on_error {
    NOSLIP_ZERO = 0, /* zero inputs */
    NOSLIP_HOLD = 1, /* the last good inputs; zero before the first */
    NOSLIP_ON_ERROR_AS_INT = -0x7fffffff
} noslip_on_error;

/* What to do if forward speed and L + d have opposite signs. */
typedef enum noslip_on_reversing {
    NOSLIP_REFUSE = 0, /* return an error */
    NOSLIP_SWITCH = 1, /* use the other of two laws, whose L + d has the sign of the speed */
    NOSLIP_ALLOW = 2,  /* continue */
    NOSLIP_ON_REVERSING_AS_INT = -0x7fffffff
} noslip_on_reversing;

/* Name of a status, in lower case; "unknown" for any other number. */
const char *noslip_status_name(int status);

#ifdef __cplusplus
}
#endif

#endif
