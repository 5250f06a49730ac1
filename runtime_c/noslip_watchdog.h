/*
 * noslip_watchdog.h - decides whether to continue, to hold the last outputs or to stop.
 *
 * Its inputs at each tick are the status of the controller, the number of ticks missed before this one, and whether a wheel is
 * stuck, that is, does not turn under a torque.
 *
 *     state          outputs             transitions
 *     NOSLIP_WATCHDOG_RUN   those of this tick  transient error: HOLD; more strikes than tolerated, another error, a stuck wheel: STOP
 *     NOSLIP_WATCHDOG_HOLD  the last good ones  good tick: RUN; more strikes than tolerated, another error, a stuck wheel: STOP
 *     NOSLIP_WATCHDOG_STOP  zero                noslip_watchdog_reset only
 *
 * Transient errors are NOSLIP_NONFINITE, NOSLIP_RANGE and NOSLIP_SINGULAR: the next tick may be good again. Each counts as one
 * strike, and so does each missed tick. Every `forgiven` good ticks in a row remove one strike. Hence the outputs are held for at
 * most `tolerated` ticks in a row, and a vehicle with frequent errors stops even if good ticks lie between them.
 */
#ifndef NOSLIP_WATCHDOG_H
#define NOSLIP_WATCHDOG_H

#include <stdint.h>

#include "noslip_status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum noslip_watchdog_state {
    NOSLIP_WATCHDOG_RUN = 0,
    NOSLIP_WATCHDOG_HOLD = 1,
    NOSLIP_WATCHDOG_STOP = 2,
    NOSLIP_WATCHDOG_STATE_AS_INT = -0x7fffffff
} noslip_watchdog_state;

/* Why it stopped. */
typedef enum noslip_watchdog_reason {
    NOSLIP_WATCHDOG_NONE = 0,
    NOSLIP_WATCHDOG_ERROR = 1,   /* an error that is not transient: see `status` */
    NOSLIP_WATCHDOG_STRIKES = 2, /* too many transient errors and missed ticks; `status` is the last error, if there was one */
    NOSLIP_WATCHDOG_STUCK = 3,   /* a wheel did not turn under a torque for too long: a broken encoder, or an obstacle */
    NOSLIP_WATCHDOG_REASON_AS_INT = -0x7fffffff
} noslip_watchdog_reason;

/* With zeros, the watchdog stops at the first error and the first missed tick, and does not detect stuck wheels. */
typedef struct noslip_watchdog_settings {
    int tolerated; /* number of strikes */
    int forgiven;  /* good ticks in a row that remove a strike; 0: strikes are never removed */
    int stuck;     /* ticks in a row for which a wheel may be stuck; 0: no limit */
} noslip_watchdog_settings;

/* Initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_watchdog {
    noslip_watchdog_settings settings;
    noslip_watchdog_state state;
    noslip_watchdog_reason reason; /* of the stop */
    int status;  /* the last error, or NOSLIP_OK */
    int strikes; /* current number */
    int good;    /* good ticks in a row */
    int stood;   /* ticks in a row in which a wheel was stuck */
    int ready;   /* set by init */
} noslip_watchdog;

/* Returns NOSLIP_BAD_PARAMETER for a negative setting. */
NOSLIP_NODISCARD int noslip_watchdog_init(noslip_watchdog *self, const noslip_watchdog_settings *settings);

/* Processes one tick and returns the state; NOSLIP_WATCHDOG_STOP if `self` is null or not ready. */
noslip_watchdog_state noslip_watchdog_step(noslip_watchdog *self, int status, uint32_t missed, int standing);

/* Returns from NOSLIP_WATCHDOG_STOP to NOSLIP_WATCHDOG_RUN without strikes, after an operator has checked the vehicle. */
int noslip_watchdog_reset(noslip_watchdog *self);

#ifdef __cplusplus
}
#endif

#endif
