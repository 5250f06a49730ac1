/*
 * motor.h - from the torque that a wheel shall have to what its motor driver is told: a DC motor with a gear.
 *
 *     torque = K current - friction rate     K = torque_constant gear efficiency, N m of the wheel per A
 *     voltage = resistance current + E rate  E = torque_constant gear, V per rad/s of the wheel
 *
 * Torque and rate are the wheel's, positive where it rolls forward. A motor mounted the other way round has a negative gear:
 * then its current and voltage are negative going forward. The efficiency is the same in both directions of power, friction is
 * viscous and sticks to nothing, the winding's inductance is left out: good where L / R is much shorter than a tick.
 *
 * Beyond the limit of current or the supply's voltage the command is the nearest that there is. A command of zero is safe: 0 V
 * shorts the winding and brakes, 0 A lets the wheel roll.
 */
#ifndef MOTOR_H
#define MOTOR_H

#include "noslip_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What the driver is told. */
enum {
    MOTOR_TORQUE = 0,  /* N m, as it is: the driver knows its motor. None of the settings below counts */
    MOTOR_CURRENT = 1, /* A */
    MOTOR_VOLTAGE = 2  /* V */
};

typedef struct motor_settings {
    int mode;              /* MOTOR_... */
    float gear;            /* turns of the motor per turn of the wheel; negative where it is mounted the other way round */
    float efficiency;      /* of the gear, above 0, at most 1 */
    float torque_constant; /* N m/A, positive; the same number in V s/rad is the constant of the back EMF */
    float friction;        /* N m s/rad: at the wheel, 0 or more */
    float resistance;      /* ohm, positive: winding, driver and cable */
    float current;         /* A, positive: the largest */
    float supply;          /* V, positive: the least that the battery has while it is in use */
} motor_settings;

/* Made by init, owned by the caller, not to be written to. */
typedef struct motor {
    float per_torque; /* A per N m of the wheel */
    float friction;   /* N m s/rad */
    float resistance; /* ohm */
    float back_emf;   /* V s/rad */
    float current;    /* A: the largest */
    float supply;     /* V */
    int mode;
    int ready; /* set by init */
} motor;

/* NOSLIP_BAD_PARAMETER unless every number that the mode needs is finite and has the sign it must have. */
int motor_init(motor *self, const motor_settings *settings);

/* The step when something is wrong, or beyond what motor and supply give: called by motor_step. */
NOSLIP_COLD int motor_at_limit(const motor *self, float torque, float rate, float *command);

/*
 * What to tell the driver (N m, A or V), for a torque (N m) at a rate (rad/s) of the wheel. NOSLIP_SATURATED where current or
 * supply do not give that torque. On an error the command is 0: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int motor_step(const motor *self, float torque, float rate, float *command)
{
    if (self != NULL && command != NULL && self->ready == NOSLIP_READY) {
        const float current = (torque + self->friction * rate) * self->per_torque;
        const float voltage = self->resistance * current + self->back_emf * rate;
        if (noslip_abs_f(current) <= self->current && noslip_abs_f(voltage) <= self->supply) { /* so both are finite */
            *command = self->mode == MOTOR_VOLTAGE ? voltage : current;
            return NOSLIP_OK;
        }
    }
    return motor_at_limit(self, torque, rate, command);
}

#ifdef __cplusplus
}
#endif

#endif
