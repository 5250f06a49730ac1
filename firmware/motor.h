/*
 * motor.h - command of a motor driver for a desired torque at the wheel: a DC motor with a gear.
 *
 *     torque = K current - friction rate     K = torque_constant gear efficiency, N m of the wheel per A
 *     voltage = resistance current + E rate  E = torque_constant gear, V per rad/s of the wheel
 *
 * Torque and rate are those of the wheel, positive when it rolls forward. A motor that is mounted the other way round has a negative
 * gear ratio: its current and voltage are negative when driving forward. The efficiency is the same in both directions of power.
 * Friction is viscous, without stiction. The inductance of the winding is neglected, which requires L / R much shorter than a tick.
 *
 * The command is limited by the maximum current and the supply voltage. A command of zero is safe: 0 V shorts the winding and
 * brakes, 0 A lets the wheel roll.
 */
#ifndef MOTOR_H
#define MOTOR_H

#include "noslip_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Kind of command that the driver takes. */
enum {
    MOTOR_TORQUE = 0,  /* N m, unchanged: the driver contains the motor model. The settings below have no effect */
    MOTOR_CURRENT = 1, /* A */
    MOTOR_VOLTAGE = 2  /* V */
};

typedef struct motor_settings {
    int mode;              /* MOTOR_... */
    float gear;            /* turns of the motor per turn of the wheel; negative if it is mounted the other way round */
    float efficiency;      /* of the gear, in (0, 1] */
    float torque_constant; /* N m/A, positive; equal to the back EMF constant in V s/rad */
    float friction;        /* N m s/rad: at the wheel, 0 or more */
    float resistance;      /* ohm, positive: winding, driver and cable */
    float current;         /* A, positive: maximum */
    float supply;          /* V, positive: lowest voltage of the battery in use */
} motor_settings;

/* Initialized by init, owned by the caller, who does not write to it. */
typedef struct motor {
    float per_torque; /* A per N m of the wheel */
    float friction;   /* N m s/rad */
    float resistance; /* ohm */
    float back_emf;   /* V s/rad */
    float current;    /* A: maximum */
    float supply;     /* V */
    int mode;
    int ready; /* set by init */
} motor;

/* Returns NOSLIP_BAD_PARAMETER unless every setting that the mode uses is finite and within its range. */
int motor_init(motor *self, const motor_settings *settings);

/* Handles errors and limits; called by motor_step. */
NOSLIP_COLD int motor_at_limit(const motor *self, float torque, float rate, float *command);

/*
 * Computes the command of the driver (N m, A or V) for a torque (N m) at a rate (rad/s) of the wheel. Returns NOSLIP_SATURATED if
 * current or supply voltage are too low for it. On an error the command is 0: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int motor_step(const motor *self, float torque, float rate, float *command)
{
    if (self != NULL && command != NULL && self->ready == NOSLIP_READY) {
        const float current = (torque + self->friction * rate) * self->per_torque;
        const float voltage = self->resistance * current + self->back_emf * rate;
        if (noslip_abs_f(current) <= self->current && noslip_abs_f(voltage) <= self->supply) { /* false for NaN */
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
