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
    NOSLIP_ARRIVED = 2,        /* good, and the end of the path is reached */
    NOSLIP_NULL = -1,          /* a pointer that must not be null is */
    NOSLIP_NONFINITE = -2,     /* a state, reference or result is infinite or NaN */
    NOSLIP_RANGE = -3,         /* an angle is beyond NOSLIP_ANGLE_MAX (double) or NOSLIP_ANGLE_MAX_F (float) */
    NOSLIP_BAD_PARAMETER = -4, /* a parameter, gain or option is not finite or has the wrong sign */
    NOSLIP_SINGULAR = -5,      /* the decoupling matrix has no inverse here, or the output no derivative */
    NOSLIP_NOT_READY = -6,     /* init was not called, or failed */
    NOSLIP_BAD_PATH = -7,      /* a path that no vehicle can follow: see its fault */
    NOSLIP_UNSTABLE = -8       /* forward speed and L + d have opposite signs: the heading would diverge */
};

/* What a controller answers on an error. */
enum {
    NOSLIP_ZERO = 0, /* zero inputs */
    NOSLIP_HOLD = 1  /* the last good inputs; zero before the first */
};

/* What happens where forward speed and L + d have opposite signs. */
enum {
    NOSLIP_REFUSE = 0, /* an error */
    NOSLIP_SWITCH = 1, /* the other of two laws is taken, whose L + d has the sign of the speed */
    NOSLIP_ALLOW = 2   /* nothing */
};

/* Name of a status, in lower case; "unknown" for any other number. */
const char *noslip_status_name(int status);

#ifdef __cplusplus
}
#endif

#endif
