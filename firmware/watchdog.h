/*
 * watchdog.h - decides whether to continue, to hold the last outputs or to stop.
 *
 * Its inputs at each tick are the status of the controller, the number of ticks missed before this one, and whether a wheel is
 * stuck, that is, does not turn under a torque.
 *
 *     state          outputs             transitions
 *     WATCHDOG_RUN   those of this tick  transient error: HOLD; more strikes than tolerated, another error, a stuck wheel: STOP
 *     WATCHDOG_HOLD  the last good ones  good tick: RUN; more strikes than tolerated, another error, a stuck wheel: STOP
 *     WATCHDOG_STOP  zero                watchdog_reset only
 *
 * Transient errors are NOSLIP_NONFINITE, NOSLIP_RANGE and NOSLIP_SINGULAR: the next tick may be good again. Each counts as one
 * strike, and so does each missed tick. Every `forgiven` good ticks in a row remove one strike. Hence the outputs are held for at
 * most `tolerated` ticks in a row, and a vehicle with frequent errors stops even if good ticks lie between them.
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
    WATCHDOG_ERROR = 1,   /* an error that is not transient: see `status` */
    WATCHDOG_STRIKES = 2, /* more transient errors and missed ticks than tolerated; `status` is the last error, if there was one */
    WATCHDOG_STUCK = 3    /* a wheel did not turn under a torque for too long: a broken encoder, or an obstacle */
};

/* With zeros, the watchdog stops at the first error and the first missed tick, and does not detect stuck wheels. */
typedef struct watchdog_settings {
    int tolerated; /* number of strikes */
    int forgiven;  /* good ticks in a row that remove a strike; 0: strikes are never removed */
    int stuck;     /* ticks in a row for which a wheel may be stuck; 0: no limit */
} watchdog_settings;

/* Initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct watchdog {
    watchdog_settings settings;
    int state;   /* WATCHDOG_RUN, WATCHDOG_HOLD or WATCHDOG_STOP */
    int reason;  /* of the stop, or WATCHDOG_NONE */
    int status;  /* the last error, or NOSLIP_OK */
    int strikes; /* current number */
    int good;    /* good ticks in a row */
    int stood;   /* ticks in a row in which a wheel was stuck */
    int ready;   /* set by init */
} watchdog;

/* Returns NOSLIP_BAD_PARAMETER for a negative setting. */
int watchdog_init(watchdog *self, const watchdog_settings *settings);

/* Processes one tick and returns the state; WATCHDOG_STOP if `self` is null or not ready. */
int watchdog_step(watchdog *self, int status, uint32_t missed, int standing);

/* Returns from WATCHDOG_STOP to WATCHDOG_RUN without strikes, after an operator has checked the vehicle. */
int watchdog_reset(watchdog *self);

#ifdef __cplusplus
}
#endif

#endif
