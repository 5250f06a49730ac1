/*
 * watchdog.h - when to go on, when to wait and when to stop for good.
 *
 * Each tick tells it the status of the controller, how many ticks were missed before this one, and whether a wheel stood under
 * a torque.
 *
 *     state          outputs             left when
 *     WATCHDOG_RUN   those of this tick  a passing error: HOLD; more strikes than tolerated, another error, a stuck wheel: STOP
 *     WATCHDOG_HOLD  the last good ones  a good tick: RUN; more strikes than tolerated, another error, a stuck wheel: STOP
 *     WATCHDOG_STOP  zero                watchdog_reset, nothing else
 *
 * Passing errors are NOSLIP_NONFINITE, NOSLIP_RANGE and NOSLIP_SINGULAR: the next tick may be good again. Each is a strike, as
 * is each tick that was missed, because the one before took too long or the clock stood still. Good ticks in a row take strikes
 * off again, one for every `forgiven`. So no more than `tolerated` ticks in a row are waited through, and nobody drives for long
 * with an error in every second one.
 */
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdint.h>

#include "noslip_status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    WATCHDOG_RUN = 0,
    WATCHDOG_HOLD = 1,
    WATCHDOG_STOP = 2
};

/* Why it stopped. */
enum {
    WATCHDOG_NONE = 0,
    WATCHDOG_ERROR = 1,   /* an error that does not pass: see `status` */
    WATCHDOG_STRIKES = 2, /* more passing errors and missed ticks than tolerated; `status` is the last error, if there was one */
    WATCHDOG_STUCK = 3    /* a wheel stood under a torque for too long: an encoder is broken, or there is a wall */
};

/* Zeros stop at the first error and at the first missed tick, and watch no wheel. */
typedef struct watchdog_settings {
    int tolerated; /* strikes */
    int forgiven;  /* good ticks in a row that take off a strike; 0: none do */
    int stuck;     /* ticks in a row that a wheel may stand under a torque; 0: any number */
} watchdog_settings;

/* Made by init, owned by the caller, to be read, not to be written to. */
typedef struct watchdog {
    watchdog_settings settings;
    int state;   /* WATCHDOG_RUN, WATCHDOG_HOLD or WATCHDOG_STOP */
    int reason;  /* WATCHDOG_NONE or why it stopped */
    int status;  /* the last error, or NOSLIP_OK */
    int strikes; /* now */
    int good;    /* ticks in a row */
    int stood;   /* ticks in a row in which a wheel stood under a torque */
    int ready;   /* set by init */
} watchdog;

/* NOSLIP_BAD_PARAMETER for a negative number. */
int watchdog_init(watchdog *self, const watchdog_settings *settings);

/* A tick: answers the state, WATCHDOG_STOP also where it is null or not ready. */
int watchdog_step(watchdog *self, int status, uint32_t missed, int standing);

/* Somebody has looked: from WATCHDOG_STOP back to WATCHDOG_RUN, all forgiven. */
int watchdog_reset(watchdog *self);

#ifdef __cplusplus
}
#endif

#endif
