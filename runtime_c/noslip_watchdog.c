/* noslip_watchdog.c - run, hold or stop, see noslip_watchdog.h. */
#include "noslip_watchdog.h"
#include "noslip_controller.h"

int noslip_watchdog_init(noslip_watchdog *self, const noslip_watchdog_settings *settings)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->state = NOSLIP_WATCHDOG_STOP;
    if (settings == NULL) {
        return NOSLIP_NULL;
    }
    if (settings->tolerated < 0 || settings->forgiven < 0 || settings->stuck < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->settings.tolerated = settings->tolerated;
    self->settings.forgiven = settings->forgiven;
    self->settings.stuck = settings->stuck;
    self->ready = NOSLIP_READY;
    return noslip_watchdog_reset(self);
}

int noslip_watchdog_reset(noslip_watchdog *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->state = NOSLIP_WATCHDOG_RUN;
    self->reason = NOSLIP_WATCHDOG_NONE;
    self->status = NOSLIP_OK;
    self->strikes = 0;
    self->good = 0;
    self->stood = 0;
    return NOSLIP_OK;
}

static noslip_watchdog_state stop(noslip_watchdog *self, noslip_watchdog_reason reason)
{
    self->state = NOSLIP_WATCHDOG_STOP;
    self->reason = reason;
    return NOSLIP_WATCHDOG_STOP;
}

/* Returns 1 for an error that may be gone at the next tick. */
static int passing(int status)
{
    return status == NOSLIP_NONFINITE || status == NOSLIP_RANGE || status == NOSLIP_SINGULAR;
}

/* Handles a tick with an error or after missed ticks. */
static noslip_watchdog_state strike(noslip_watchdog *self, int status, uint32_t missed)
{
    const uint32_t left = (uint32_t)(self->settings.tolerated - self->strikes);
    self->good = 0;
    if (status < 0) {
        self->status = status;
        if (!passing(status)) {
            return stop(self, NOSLIP_WATCHDOG_ERROR);
        }
    }
    if (missed > left || missed + (status < 0) > left) {
        return stop(self, NOSLIP_WATCHDOG_STRIKES);
    }
    self->strikes += (int)missed + (status < 0);
    self->state = status < 0 ? NOSLIP_WATCHDOG_HOLD : NOSLIP_WATCHDOG_RUN;
    return self->state;
}

/* Handles a good tick after strikes. */
static noslip_watchdog_state forgive(noslip_watchdog *self)
{
    self->state = NOSLIP_WATCHDOG_RUN;
    if (self->strikes > 0 && self->settings.forgiven > 0 && ++self->good >= self->settings.forgiven) {
        self->strikes--;
        self->good = 0;
    }
    return NOSLIP_WATCHDOG_RUN;
}

/* Handles every tick but a good one without strikes. */
static NOSLIP_COLD noslip_watchdog_state other_tick(noslip_watchdog *self, int status, uint32_t missed, int standing)
{
    if (self == NULL || self->ready != NOSLIP_READY || self->state == NOSLIP_WATCHDOG_STOP) {
        return NOSLIP_WATCHDOG_STOP;
    }
    if (!standing || self->settings.stuck == 0) {
        self->stood = 0;
    } else if (self->stood >= self->settings.stuck) { /* also where one more would overflow */
        return stop(self, NOSLIP_WATCHDOG_STUCK);
    } else {
        self->stood++;
    }
    return status < 0 || missed > 0 ? strike(self, status, missed) : forgive(self);
}

noslip_watchdog_state noslip_watchdog_step(noslip_watchdog *self, int status, uint32_t missed, int standing)
{
    if (self != NULL && self->ready == NOSLIP_READY && status >= 0 && missed == 0 && standing == 0 &&
        ((int)self->state | self->strikes | self->stood) == 0) {
        return NOSLIP_WATCHDOG_RUN;
    }
    return other_tick(self, status, missed, standing);
}
