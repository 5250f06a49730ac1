/*
 * noslip_motor.h - command of a motor driver for a desired torque at the wheel: a DC motor with a gear.
 *
 *     torque = E current e - friction rate - dry_friction sign(rate)     E = torque_constant gear, N m of the wheel per A
 *     voltage = resistance current + E rate
 *
 * The factor e is `efficiency` where power flows from the motor to the wheel, and 1 / back_efficiency where it flows back. Torque and
 * rate are those of the wheel, positive when it rolls forward. A motor that is mounted the other way round has a negative gear ratio:
 * its current and voltage are negative when driving forward. The inductance of the winding is neglected, which requires L / R much
 * shorter than a tick. A brushless motor with a current loop is a DC motor here.
 *
 * At standstill the direction of friction is unknown, and a measured rate changes its sign there. Below the rate `moving`, dry friction
 * and the change to back_efficiency are therefore compensated in proportion to the rate, so that the command is continuous. At
 * standstill the gear counts as driven by the motor.
 *
 * The command is limited by the maximum current and the supply voltage. A command of zero is safe: 0 V shorts the winding and
 * brakes, 0 A lets the wheel roll. What the motor can do at its present rate is given to the law as its limits, so that the law slows
 * down or keeps its path within it:
 *
 *     noslip_motor_init(&motor, &settings);
 *     noslip_motor_limit(&motor, rate, &limit);                       at each tick, before the step of the law
 *     noslip_motor_step(&motor, tau[0], rate, &command);              after it
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_MOTOR_H
#define NOSLIP_MOTOR_H

#include "noslip_controller.h"

/* Kind of command that the driver takes. */
typedef enum noslip_motor_mode {
    NOSLIP_MOTOR_TORQUE = 0,  /* N m, unchanged: the driver contains the motor model */
    NOSLIP_MOTOR_CURRENT = 1, /* A */
    NOSLIP_MOTOR_VOLTAGE = 2, /* V */
    NOSLIP_MOTOR_DUTY = 3,    /* voltage as a part of the supply, -1 to 1: PWM of a bridge */
    NOSLIP_MOTOR_MODE_AS_INT = -0x7fffffff
} noslip_motor_mode;

/* -- double: generated from noslip_motor.inc by guarantees/headers.py -------------------------------------------------- */

/* A motor with its gear and driver. With NOSLIP_MOTOR_TORQUE only `mode` has an effect. */
typedef struct noslip_motor_settings {
    noslip_motor_mode mode;
    double gear;                 /* turns of the motor per turn of the wheel; negative if it is mounted the other way round */
    double efficiency;           /* of the gear where the motor drives the wheel, in (0, 1] */
    double back_efficiency;      /* of the gear where the wheel drives the motor, in (0, 1] */
    double torque_constant;      /* N m/A, positive; equal to the back EMF constant in V s/rad */
    double friction;             /* N m s/rad: viscous, at the wheel; 0 or more */
    double dry_friction;         /* N m: Coulomb friction at the wheel; 0 or more */
    double moving;               /* rad/s, positive: rate of the wheel from which on its direction counts in full, see above */
    double resistance;           /* ohm, positive: winding, driver and cable */
    double current;              /* A, positive: maximum */
    double supply;               /* V, positive: lowest voltage of the battery in use */
} noslip_motor_settings;

/* Initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_motor {
    double per_torque;           /* A per N m of the wheel where the motor drives the wheel */
    double back_change;          /* A per N m: by how much it differs where the wheel drives the motor */
    double friction;             /* N m s/rad */
    double dry_friction;         /* N m */
    double per_moving;           /* s/rad: 1 / moving */
    double resistance;           /* ohm */
    double back_emf;             /* V s/rad */
    double current, supply;      /* A, V: maximum */
    double standing;             /* N m: largest torque at standstill */
    noslip_motor_mode mode;
    int ready; /* set by init */
} noslip_motor;

/* Returns 1 if the settings of a mode other than NOSLIP_MOTOR_TORQUE are finite and within their ranges. */
static inline int noslip_motor_ok(const noslip_motor_settings *of)
{
    return (of->mode == NOSLIP_MOTOR_CURRENT || of->mode == NOSLIP_MOTOR_VOLTAGE || of->mode == NOSLIP_MOTOR_DUTY) &&
           noslip_is_positive(noslip_abs(of->gear)) &&
           noslip_is_positive(of->efficiency) && of->efficiency <= 1 &&
           noslip_is_positive(of->back_efficiency) && of->back_efficiency <= 1 &&
           noslip_is_positive(of->torque_constant) && noslip_is_limit(of->friction) &&
           noslip_is_limit(of->dry_friction) && noslip_is_positive(of->moving) &&
           noslip_is_positive(of->resistance) && noslip_is_positive(of->current) &&
           noslip_is_positive(of->supply);
}

/* Returns the largest torque at standstill, from the current or the supply, whichever is less. */
static inline double noslip_motor_standing(const noslip_motor *self)
{
    const double stalled = self->supply / self->resistance;
    return (stalled < self->current ? stalled : self->current) / noslip_abs(self->per_torque);
}

/*
 * Initializes a motor. Returns NOSLIP_BAD_PARAMETER unless every setting that the mode uses is finite and within its range, and so
 * are the quotients computed from them.
 */
NOSLIP_NODISCARD static inline int noslip_motor_init(noslip_motor *self,
                       const noslip_motor_settings *settings)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->mode = NOSLIP_MOTOR_TORQUE;
    self->per_torque = 1; /* with NOSLIP_MOTOR_TORQUE a motor without losses: 1 A per N m */
    self->back_change = 0;
    self->friction = 0;
    self->dry_friction = 0;
    self->per_moving = 0;
    self->resistance = 0;
    self->back_emf = 0;
    self->current = DBL_MAX;
    self->supply = DBL_MAX;
    self->standing = DBL_MAX;
    if (settings == NULL) {
        return NOSLIP_NULL;
    }
    if (settings->mode != NOSLIP_MOTOR_TORQUE) {
        double per_current;
        if (!noslip_motor_ok(settings)) {
            return NOSLIP_BAD_PARAMETER;
        }
        self->mode = settings->mode;
        self->back_emf = settings->torque_constant * settings->gear;
        per_current = self->back_emf * settings->efficiency;
        if (!noslip_is_positive(noslip_abs(per_current))) {
            return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
        }
        self->per_torque = 1 / per_current;
        self->back_change = settings->back_efficiency / self->back_emf - self->per_torque;
        self->friction = settings->friction;
        self->dry_friction = settings->dry_friction;
        self->per_moving = 1 / settings->moving;
        self->resistance = settings->resistance;
        self->current = settings->current;
        self->supply = settings->supply;
        self->standing = noslip_motor_standing(self);
        if (!(noslip_is_positive(self->standing) && noslip_is_positive(self->per_moving) &&
              noslip_sum_finite(self->back_emf, self->per_torque, self->back_change))) {
            return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
        }
    }
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the current (A) that gives the wheel a torque (N m) at a rate (rad/s), without limits. */
static inline double noslip_motor_current(const noslip_motor *self, double torque,
                        double rate)
{
    const double forward = noslip_clip(rate * self->per_moving, 1);
    const double loaded = torque + (self->friction * rate + self->dry_friction * forward);
    const double back = loaded > 0 ? -forward : forward;      /* the share of `back_change`, if positive */
    return loaded * (back > 0 ? self->per_torque + self->back_change * back : self->per_torque);
}

/* Returns the command for a current (A) at a voltage (V). */
static inline double noslip_motor_command(const noslip_motor *self, double current,
                        double voltage)
{
    return self->mode == NOSLIP_MOTOR_VOLTAGE ? voltage
           : self->mode == NOSLIP_MOTOR_DUTY  ? noslip_clip(voltage / self->supply, 1)
                                              : current;
}

/* Handles errors and limits of noslip_motor_step. */
NOSLIP_APART int noslip_motor_at_limit(const noslip_motor *self, double torque, double rate,
                double *command)
{
    double current, emf, voltage;
    if (command == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        *command = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    current = noslip_motor_current(self, torque, rate);
    emf = self->back_emf * rate;
    if (!noslip_is_finite(current) || !noslip_is_finite(emf)) {
        *command = 0;
        return NOSLIP_NONFINITE;
    }
    current = noslip_clip(current, self->current);
    voltage = self->resistance * current + emf;
    if (!noslip_within(voltage, self->supply)) {
        voltage = noslip_clip(voltage, self->supply);
        current = noslip_clip((voltage - emf) / self->resistance, self->current);
    }
    *command = noslip_motor_command(self, current, voltage);
    return NOSLIP_SATURATED;
}

/*
 * Computes the command of the driver for a torque (N m) at a rate (rad/s) of the wheel. Returns NOSLIP_SATURATED if current or
 * supply voltage are too low for it. On an error the command is 0: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int noslip_motor_step(const noslip_motor *self, double torque, double rate,
             double *command)
{
    if (self != NULL && command != NULL && self->ready == NOSLIP_READY) {
        const double current = noslip_motor_current(self, torque, rate);
        const double voltage = self->resistance * current + self->back_emf * rate;
        if (noslip_within(current, self->current) && noslip_within(voltage, self->supply)) {
            *command = noslip_motor_command(self, current, voltage);
            return NOSLIP_OK;
        }
    }
    return noslip_motor_at_limit(self, torque, rate, command);
}

/*
 * Writes the largest torque (N m) that the motor has at a rate (rad/s) of the wheel: in the direction in which the wheel turns, where
 * the back EMF leaves the least of the supply, but at least 1/20 of that at standstill, so that a wheel which turns faster than
 * the supply allows can still be braked. With NOSLIP_MOTOR_TORQUE it is the largest number. On an error the torque is 0: NOSLIP_NULL,
 * NOSLIP_NOT_READY, or NOSLIP_NONFINITE for a rate that is not finite.
 */
static inline int noslip_motor_limit(const noslip_motor *self, double rate, double *torque)
{
    const double size = noslip_abs(rate);
    double most = 0;
    int status = NOSLIP_NONFINITE;
    if (self == NULL || torque == NULL) {
        if (torque != NULL) {
            *torque = 0;
        }
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        status = NOSLIP_NOT_READY;
    } else if (self->mode == NOSLIP_MOTOR_TORQUE) {
        most = self->standing;
        status = noslip_is_finite(rate) ? NOSLIP_OK : status;
    } else if (noslip_is_finite(size)) {
        double current = (self->supply - noslip_abs(self->back_emf) * size) / self->resistance;
        current = current < self->current ? current : self->current;
        most = current / noslip_abs(self->per_torque) -
               (self->friction * size + self->dry_friction * noslip_clip(size * self->per_moving, 1));
        most = most > (double)0.05 * self->standing ? most : (double)0.05 * self->standing;
        status = NOSLIP_OK;
    }
    *torque = status == NOSLIP_OK ? most : 0;
    return status;
}

/* Sets the voltage of the supply (V), such as that of the battery as measured now. Returns NOSLIP_NULL, NOSLIP_NOT_READY, or
 * NOSLIP_BAD_PARAMETER for a voltage that is not finite and positive; then nothing changes. No effect with NOSLIP_MOTOR_TORQUE. */
static inline int noslip_motor_set_supply(noslip_motor *self, double supply)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_positive(supply)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (self->mode != NOSLIP_MOTOR_TORQUE) {
        self->supply = supply;
        self->standing = noslip_motor_standing(self);
    }
    return NOSLIP_OK;
}

/* -- float: generated from noslip_motor.inc by guarantees/headers.py --------------------------------------------------- */

/* A motor with its gear and driver. With NOSLIP_MOTOR_TORQUE only `mode` has an effect. */
typedef struct noslip_motor_settings_f {
    noslip_motor_mode mode;
    float gear;                  /* turns of the motor per turn of the wheel; negative if it is mounted the other way round */
    float efficiency;            /* of the gear where the motor drives the wheel, in (0, 1] */
    float back_efficiency;       /* of the gear where the wheel drives the motor, in (0, 1] */
    float torque_constant;       /* N m/A, positive; equal to the back EMF constant in V s/rad */
    float friction;              /* N m s/rad: viscous, at the wheel; 0 or more */
    float dry_friction;          /* N m: Coulomb friction at the wheel; 0 or more */
    float moving;                /* rad/s, positive: rate of the wheel from which on its direction counts in full, see above */
    float resistance;            /* ohm, positive: winding, driver and cable */
    float current;               /* A, positive: maximum */
    float supply;                /* V, positive: lowest voltage of the battery in use */
} noslip_motor_settings_f;

/* Initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_motor_f {
    float per_torque;            /* A per N m of the wheel where the motor drives the wheel */
    float back_change;           /* A per N m: by how much it differs where the wheel drives the motor */
    float friction;              /* N m s/rad */
    float dry_friction;          /* N m */
    float per_moving;            /* s/rad: 1 / moving */
    float resistance;            /* ohm */
    float back_emf;              /* V s/rad */
    float current, supply;       /* A, V: maximum */
    float standing;              /* N m: largest torque at standstill */
    noslip_motor_mode mode;
    int ready; /* set by init */
} noslip_motor_f;

/* Returns 1 if the settings of a mode other than NOSLIP_MOTOR_TORQUE are finite and within their ranges. */
static inline int noslip_motor_ok_f(const noslip_motor_settings_f *of)
{
    return (of->mode == NOSLIP_MOTOR_CURRENT || of->mode == NOSLIP_MOTOR_VOLTAGE || of->mode == NOSLIP_MOTOR_DUTY) &&
           noslip_is_positive_f(noslip_abs_f(of->gear)) &&
           noslip_is_positive_f(of->efficiency) && of->efficiency <= 1 &&
           noslip_is_positive_f(of->back_efficiency) && of->back_efficiency <= 1 &&
           noslip_is_positive_f(of->torque_constant) && noslip_is_limit_f(of->friction) &&
           noslip_is_limit_f(of->dry_friction) && noslip_is_positive_f(of->moving) &&
           noslip_is_positive_f(of->resistance) && noslip_is_positive_f(of->current) &&
           noslip_is_positive_f(of->supply);
}

/* Returns the largest torque at standstill, from the current or the supply, whichever is less. */
static inline float noslip_motor_standing_f(const noslip_motor_f *self)
{
    const float stalled = self->supply / self->resistance;
    return (stalled < self->current ? stalled : self->current) / noslip_abs_f(self->per_torque);
}

/*
 * Initializes a motor. Returns NOSLIP_BAD_PARAMETER unless every setting that the mode uses is finite and within its range, and so
 * are the quotients computed from them.
 */
NOSLIP_NODISCARD static inline int noslip_motor_init_f(noslip_motor_f *self,
                           const noslip_motor_settings_f *settings)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->mode = NOSLIP_MOTOR_TORQUE;
    self->per_torque = 1; /* with NOSLIP_MOTOR_TORQUE a motor without losses: 1 A per N m */
    self->back_change = 0;
    self->friction = 0;
    self->dry_friction = 0;
    self->per_moving = 0;
    self->resistance = 0;
    self->back_emf = 0;
    self->current = FLT_MAX;
    self->supply = FLT_MAX;
    self->standing = FLT_MAX;
    if (settings == NULL) {
        return NOSLIP_NULL;
    }
    if (settings->mode != NOSLIP_MOTOR_TORQUE) {
        float per_current;
        if (!noslip_motor_ok_f(settings)) {
            return NOSLIP_BAD_PARAMETER;
        }
        self->mode = settings->mode;
        self->back_emf = settings->torque_constant * settings->gear;
        per_current = self->back_emf * settings->efficiency;
        if (!noslip_is_positive_f(noslip_abs_f(per_current))) {
            return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
        }
        self->per_torque = 1 / per_current;
        self->back_change = settings->back_efficiency / self->back_emf - self->per_torque;
        self->friction = settings->friction;
        self->dry_friction = settings->dry_friction;
        self->per_moving = 1 / settings->moving;
        self->resistance = settings->resistance;
        self->current = settings->current;
        self->supply = settings->supply;
        self->standing = noslip_motor_standing_f(self);
        if (!(noslip_is_positive_f(self->standing) && noslip_is_positive_f(self->per_moving) &&
              noslip_sum_finite_f(self->back_emf, self->per_torque, self->back_change))) {
            return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
        }
    }
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the current (A) that gives the wheel a torque (N m) at a rate (rad/s), without limits. */
static inline float noslip_motor_current_f(const noslip_motor_f *self, float torque,
                          float rate)
{
    const float forward = noslip_clip_f(rate * self->per_moving, 1);
    const float loaded = torque + (self->friction * rate + self->dry_friction * forward);
    const float back = loaded > 0 ? -forward : forward;       /* the share of `back_change`, if positive */
    return loaded * (back > 0 ? self->per_torque + self->back_change * back : self->per_torque);
}

/* Returns the command for a current (A) at a voltage (V). */
static inline float noslip_motor_command_f(const noslip_motor_f *self, float current,
                          float voltage)
{
    return self->mode == NOSLIP_MOTOR_VOLTAGE ? voltage
           : self->mode == NOSLIP_MOTOR_DUTY  ? noslip_clip_f(voltage / self->supply, 1)
                                              : current;
}

/* Handles errors and limits of noslip_motor_step. */
NOSLIP_APART int noslip_motor_at_limit_f(const noslip_motor_f *self, float torque, float rate,
                  float *command)
{
    float current, emf, voltage;
    if (command == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        *command = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    current = noslip_motor_current_f(self, torque, rate);
    emf = self->back_emf * rate;
    if (!noslip_is_finite_f(current) || !noslip_is_finite_f(emf)) {
        *command = 0;
        return NOSLIP_NONFINITE;
    }
    current = noslip_clip_f(current, self->current);
    voltage = self->resistance * current + emf;
    if (!noslip_within_f(voltage, self->supply)) {
        voltage = noslip_clip_f(voltage, self->supply);
        current = noslip_clip_f((voltage - emf) / self->resistance, self->current);
    }
    *command = noslip_motor_command_f(self, current, voltage);
    return NOSLIP_SATURATED;
}

/*
 * Computes the command of the driver for a torque (N m) at a rate (rad/s) of the wheel. Returns NOSLIP_SATURATED if current or
 * supply voltage are too low for it. On an error the command is 0: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int noslip_motor_step_f(const noslip_motor_f *self, float torque, float rate,
               float *command)
{
    if (self != NULL && command != NULL && self->ready == NOSLIP_READY) {
        const float current = noslip_motor_current_f(self, torque, rate);
        const float voltage = self->resistance * current + self->back_emf * rate;
        if (noslip_within_f(current, self->current) && noslip_within_f(voltage, self->supply)) {
            *command = noslip_motor_command_f(self, current, voltage);
            return NOSLIP_OK;
        }
    }
    return noslip_motor_at_limit_f(self, torque, rate, command);
}

/*
 * Writes the largest torque (N m) that the motor has at a rate (rad/s) of the wheel: in the direction in which the wheel turns, where
 * the back EMF leaves the least of the supply, but at least 1/20 of that at standstill, so that a wheel which turns faster than
 * the supply allows can still be braked. With NOSLIP_MOTOR_TORQUE it is the largest number. On an error the torque is 0: NOSLIP_NULL,
 * NOSLIP_NOT_READY, or NOSLIP_NONFINITE for a rate that is not finite.
 */
static inline int noslip_motor_limit_f(const noslip_motor_f *self, float rate, float *torque)
{
    const float size = noslip_abs_f(rate);
    float most = 0;
    int status = NOSLIP_NONFINITE;
    if (self == NULL || torque == NULL) {
        if (torque != NULL) {
            *torque = 0;
        }
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        status = NOSLIP_NOT_READY;
    } else if (self->mode == NOSLIP_MOTOR_TORQUE) {
        most = self->standing;
        status = noslip_is_finite_f(rate) ? NOSLIP_OK : status;
    } else if (noslip_is_finite_f(size)) {
        float current = (self->supply - noslip_abs_f(self->back_emf) * size) / self->resistance;
        current = current < self->current ? current : self->current;
        most = current / noslip_abs_f(self->per_torque) -
               (self->friction * size + self->dry_friction * noslip_clip_f(size * self->per_moving, 1));
        most = most > (float)0.05 * self->standing ? most : (float)0.05 * self->standing;
        status = NOSLIP_OK;
    }
    *torque = status == NOSLIP_OK ? most : 0;
    return status;
}

/* Sets the voltage of the supply (V), such as that of the battery as measured now. Returns NOSLIP_NULL, NOSLIP_NOT_READY, or
 * NOSLIP_BAD_PARAMETER for a voltage that is not finite and positive; then nothing changes. No effect with NOSLIP_MOTOR_TORQUE. */
static inline int noslip_motor_set_supply_f(noslip_motor_f *self, float supply)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_positive_f(supply)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (self->mode != NOSLIP_MOTOR_TORQUE) {
        self->supply = supply;
        self->standing = noslip_motor_standing_f(self);
    }
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
