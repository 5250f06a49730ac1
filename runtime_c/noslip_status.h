/*
 * noslip_status.h - what every entry point answers: 0 or positive, the answer is good; negative, it is not.
 */
#ifndef NOSLIP_STATUS_H
#define NOSLIP_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

enum {
    NOSLIP_OK = 0,
    NOSLIP_SATURATED = 1,      /* good, but an input was cut to its limit */
    NOSLIP_NULL = -1,          /* a pointer that must not be null is */
    NOSLIP_NONFINITE = -2,     /* a state, reference or result is infinite or NaN */
    NOSLIP_RANGE = -3,         /* an angle is beyond NOSLIP_ANGLE_MAX (double) or NOSLIP_ANGLE_MAX_F (float) */
    NOSLIP_BAD_PARAMETER = -4, /* a parameter, gain or option is not finite or has the wrong sign */
    NOSLIP_SINGULAR = -5,      /* the decoupling matrix has no inverse here, or the output no derivative */
    NOSLIP_NOT_READY = -6      /* init was not called, or failed */
};

/* What a controller answers on an error. */
enum {
    NOSLIP_ZERO = 0, /* zero inputs */
    NOSLIP_HOLD = 1  /* the last good inputs; zero before the first */
};

/* Name of a status, in lower case; "unknown" for any other number. */
const char *noslip_status_name(int status);

#ifdef __cplusplus
}
#endif

#endif
