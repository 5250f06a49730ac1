/* motor.c - a DC motor with a gear, see motor.h. */
#include <stddef.h>

#include "motor.h"

int motor_init(motor *self, const motor_settings *settings)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (settings == NULL) {
        return NOSLIP_NULL;
    }
    if (settings->mode == MOTOR_TORQUE) { /* 1 A per N m, without losses or limits */
        self->per_torque = 1;
        self->friction = 0;
        self->resistance = 0;
        self->back_emf = 0;
        self->current = FLT_MAX;
        self->supply = FLT_MAX;
    } else {
        if ((settings->mode != MOTOR_CURRENT && settings->mode != MOTOR_VOLTAGE) ||
            !noslip_is_positive_f(noslip_abs_f(settings->gear)) || !noslip_is_positive_f(settings->efficiency) || settings->efficiency > 1 ||
            !noslip_is_positive_f(settings->torque_constant) || !noslip_limits_ok_f(&settings->friction, 1) ||
            !noslip_is_positive_f(settings->resistance) || !noslip_is_positive_f(settings->current) || !noslip_is_positive_f(settings->supply)) {
            return NOSLIP_BAD_PARAMETER;
        }
        self->back_emf = settings->torque_constant * settings->gear;
        self->per_torque = 1 / (self->back_emf * settings->efficiency);
        self->friction = settings->friction;
        self->resistance = settings->resistance;
        self->current = settings->current;
        self->supply = settings->supply;
        if (!noslip_is_finite_f(self->per_torque) || !noslip_is_finite_f(self->back_emf)) {
            return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
        }
    }
    self->mode = settings->mode;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the number limited to [-limit, limit]. */
static float clamp(float number, float limit)
{
    return number > limit ? limit : number < -limit ? -limit : number;
}

int motor_at_limit(const motor *self, float torque, float rate, float *command)
{
    float current, emf, voltage;
    if (self == NULL || command == NULL) {
        if (command != NULL) {
            *command = 0;
        }
        return NOSLIP_NULL;
    }
    *command = 0;
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    current = (torque + self->friction * rate) * self->per_torque;
    emf = self->back_emf * rate;
    if (!noslip_is_finite_f(current) || !noslip_is_finite_f(emf)) {
        return NOSLIP_NONFINITE;
    }
    current = clamp(current, self->current);
    voltage = self->resistance * current + emf;
    if (noslip_abs_f(voltage) > self->supply) {
        voltage = clamp(voltage, self->supply);
        current = clamp((voltage - emf) / self->resistance, self->current);
    }
    *command = self->mode == MOTOR_VOLTAGE ? voltage : current;
    return NOSLIP_SATURATED;
}
