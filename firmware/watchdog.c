/* watchdog.c - run, hold or stop, see watchdog.h. */
#include <stddef.h>

#include "noslip_controller.h"
#include "watchdog.h"

int watchdog_init(watchdog *self, const watchdog_settings *settings)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->state = WATCHDOG_STOP;
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
    return watchdog_reset(self);
}

int watchdog_reset(watchdog *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->state = WATCHDOG_RUN;
    self->reason = WATCHDOG_NONE;
    self->status = NOSLIP_OK;
    self->strikes = 0;
    self->good = 0;
    self->stood = 0;
    return NOSLIP_OK;
}

static int stop(watchdog *self, int reason)
{
    self->state = WATCHDOG_STOP;
    self->reason = reason;
    return WATCHDOG_STOP;
}

/* Returns 1 for an error that may be gone at the next tick. */
static int passing(int status)
{
    return status == NOSLIP_NONFINITE || status == NOSLIP_RANGE || status == NOSLIP_SINGULAR;
}

/* Handles a tick with an error or after missed ticks. */
static int strike(watchdog *self, int status, uint32_t missed)
{
    const uint32_t left = (uint32_t)(self->settings.tolerated - self->strikes);
    self->good = 0;
    if (status < 0) {
        self->status = status;
        if (!passing(status)) {
            return stop(self, WATCHDOG_ERROR);
        }
    }
    if (missed > left || missed + (status < 0) > left) {
        return stop(self, WATCHDOG_STRIKES);
    }
    self->strikes += (int)missed + (status < 0);
    self->state = status < 0 ? WATCHDOG_HOLD : WATCHDOG_RUN;
    return self->state;
}

/* Handles a good tick after strikes. */
static int forgive(watchdog *self)
{
    self->state = WATCHDOG_RUN;
    if (self->strikes > 0 && self->settings.forgiven > 0 && ++self->good >= self->settings.forgiven) {
        self->strikes--;
        self->good = 0;
    }
    return WATCHDOG_RUN;
}

/* Handles every tick but a good one without strikes. */
static NOSLIP_COLD int watchdog_other_tick(watchdog *self, int status, uint32_t missed, int standing)
{
    if (self == NULL || self->ready != NOSLIP_READY || self->state == WATCHDOG_STOP) {
        return WATCHDOG_STOP;
    }
    self->stood = standing && self->settings.stuck > 0 ? self->stood + 1 : 0;
    if (self->stood > self->settings.stuck) {
        return stop(self, WATCHDOG_STUCK);
    }
    return status < 0 || missed > 0 ? strike(self, status, missed) : forgive(self);
}

int watchdog_step(watchdog *self, int status, uint32_t missed, int standing)
{
    if (self != NULL && self->ready == NOSLIP_READY && status >= 0 && missed == 0 && standing == 0 &&
        (self->state | self->strikes | self->stood) == 0) {
        return WATCHDOG_RUN;
    }
    return watchdog_other_tick(self, status, missed, standing);
}
