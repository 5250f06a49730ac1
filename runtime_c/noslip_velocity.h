/*
 * noslip_velocity.h - commands for drives that take a velocity instead of a torque.
 *
 * A law returns the torques tau that cause the accelerations u of the quasi-velocities nu, such as the rates of the wheels. A drive
 * with a velocity loop of its own is given nu + integral of u: the velocities to which u leads until the next call. With the C of
 * the robot's dynamics, u is the acceleration that tau causes, after all limits of the law:
 *
 *     noslip_velocity_init(&velocity, limits, 2, period);
 *     noslip_velocity_reset(&velocity, nu);                       the measured velocities, at the start
 *
 * At each call of the controller:
 *
 *     status = labmate_type_iv_circle_step(&law, &state, &reference, tau);
 *     error = labmate_dynamics_acceleration(&dynamics, &state, tau, qdot, u);
 *     noslip_velocity_step(&velocity, u, nu, status < 0 ? status : error, period, command);
 *
 * A drive that takes a feed-forward torque beside the velocity is given tau too. docs/drives.md says what to enter, and how to find
 * out which gains are stable behind a drive.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_VELOCITY_H
#define NOSLIP_VELOCITY_H

#include "noslip_controller.h"

#define NOSLIP_VELOCITIES 8 /* quasi-velocities of a robot, at most */

/* What the drives take. */
typedef enum noslip_drive {
    NOSLIP_DRIVE_TORQUE = 0,   /* torques, or the currents or voltages that cause them: noslip_motor.h */
    NOSLIP_DRIVE_VELOCITY = 1, /* velocities */
    NOSLIP_DRIVE_AS_INT = -0x7fffffff
} noslip_drive;

/* -- double: generated from noslip_velocity.inc by guarantees/headers.py ----------------------------------------------- */

/* Limits of one quasi-velocity, such as the rate of a wheel; all must be positive. Units: those of the quasi-velocity. */
typedef struct noslip_velocity_limits {
    double speed;             /* largest command, such as rad/s */
    double acceleration;      /* largest change of the command per second, such as rad/s^2 */
    double band;              /* largest difference between command and measured velocity, such as rad/s */
} noslip_velocity_limits;

/* Commands for velocity-controlled drives: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_velocity {
    noslip_velocity_limits limits[NOSLIP_VELOCITIES];
    double command[NOSLIP_VELOCITIES];      /* of the last step */
    double period;                          /* s */
    int count;                              /* of quasi-velocities */
    int ready;
} noslip_velocity;

/*
 * Initializes with commands of zero. `limits`: one struct for each of `count` quasi-velocities, at most NOSLIP_VELOCITIES;
 * `period` (s) is the usual time between two steps. Returns NOSLIP_BAD_PARAMETER for another count, or a limit, a period or a change
 * in two periods that is not finite and positive.
 */
NOSLIP_NODISCARD static inline int noslip_velocity_init(noslip_velocity *self,
                          const noslip_velocity_limits *limits, int count,
                          double period)
{
    int i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (limits == NULL) {
        return NOSLIP_NULL;
    }
    if (count < 1 || count > NOSLIP_VELOCITIES || !noslip_is_positive(period)) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_is_positive(limits[i].speed) && noslip_is_positive(limits[i].band) &&
              noslip_is_positive(limits[i].acceleration) &&
              noslip_is_positive(limits[i].acceleration * (2 * period)))) {
            return NOSLIP_BAD_PARAMETER;
        }
        self->limits[i] = limits[i];
        self->command[i] = 0;
    }
    self->period = period;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Restarts from the measured velocities `nu`, so that the drives get no jump: before the first step, and after the drives were
 * off. Commands are limited to the largest speeds. On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int noslip_velocity_reset(noslip_velocity *self, const double *nu)
{
    int i;
    if (self == NULL || nu == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_all_finite(nu, self->count)) {
        return NOSLIP_NONFINITE;
    }
    for (i = 0; i < self->count; i++) {
        self->command[i] = noslip_clip(nu[i], self->limits[i].speed);
    }
    return NOSLIP_OK;
}

/*
 * Moves `target` towards the commands so that no acceleration exceeds its limit over dt (s): all changes are divided by the same
 * number, which keeps their proportions. Returns NOSLIP_SATURATED if that was needed, NOSLIP_NONFINITE if it is not possible.
 */
static inline int noslip_velocity_limit(const noslip_velocity *self, double *target, double dt)
{
    double most = 1;
    int i;
    for (i = 0; i < self->count; i++) {
        const double change = noslip_abs(target[i] - self->command[i]);
        const double step = self->limits[i].acceleration * dt;
        if (!(step > 0 && noslip_is_finite(change) && noslip_is_finite(change / step))) {
            return NOSLIP_NONFINITE;
        }
        most = change / step > most ? change / step : most;
    }
    if (!(most > 1)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < self->count; i++) {
        const double from = self->command[i], step = self->limits[i].acceleration * dt;
        target[i] = from + noslip_clip((target[i] - from) / most, step);
    }
    return NOSLIP_SATURATED;
}

/*
 * Computes `target` from the accelerations u and the measured velocities: the velocities that u leads to in dt, within every limit.
 * Returns as noslip_velocity_limit.
 */
static inline int noslip_velocity_target(const noslip_velocity *self, const double *u,
                       const double *nu, double dt, double *target)
{
    double most = 1;
    int i, limited, again;
    for (i = 0; i < self->count; i++) {
        target[i] = self->command[i] + u[i] * dt;
    }
    limited = noslip_velocity_limit(self, target, dt);
    if (limited < 0) {
        return limited;
    }
    for (i = 0; i < self->count; i++) {
        const double ratio = noslip_abs(target[i]) / self->limits[i].speed;
        most = ratio > most ? ratio : most;
    }
    for (i = 0; i < self->count; i++) {
        const double slowed = target[i] / most, band = self->limits[i].band;
        const double low = nu[i] - band, high = nu[i] + band;
        const double near = slowed > high ? high : slowed < low ? low : slowed;
        const double made = noslip_clip(near, self->limits[i].speed);
        limited = made > target[i] || made < target[i] ? NOSLIP_SATURATED : limited;
        target[i] = made;
    }
    again = noslip_velocity_limit(self, target, dt);
    return again == NOSLIP_OK ? limited : again;
}

/*
 * Writes `count` commands: the velocities that the accelerations u lead to in dt (s), the time to the next step, of 0 to 2 periods.
 * `nu` are the measured velocities, `status` is what the step of the law returned.
 *
 * - No command exceeds its limit `speed`, and none changes faster than its limit `acceleration`. If u would, all accelerations are
 *   divided by the same number, and so are all speeds, so that the vehicle keeps its curvature.
 * - A command farther than `band` from the measured velocity, such as that of a blocked wheel, goes back (anti-windup).
 * - On an error, in `status` or in an argument, u is not used: the commands go to zero together with the largest accelerations; over
 *   `period` if dt is not usable.
 *
 * Returns the error, `status` if it is positive, NOSLIP_SATURATED if a command was limited, else NOSLIP_OK. NOSLIP_NONFINITE: a
 * number is not finite or leads beyond finite numbers; NOSLIP_RANGE: dt; NOSLIP_NULL: u or nu. Nothing is written without `self` or
 * `command` (NOSLIP_NULL) or before init (NOSLIP_NOT_READY).
 */
static inline int noslip_velocity_step(noslip_velocity *self, const double *u,
                     const double *nu, int status, double dt, double *command)
{
    double target[NOSLIP_VELOCITIES], time;
    int i, made = NOSLIP_OK;
    if (self == NULL || command == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    noslip_write_zeros(target, NOSLIP_VELOCITIES);
    time = dt > 0 && dt <= 2 * self->period ? dt : self->period;
    if (status < 0) {
        made = status;
    } else if (u == NULL || nu == NULL) {
        made = NOSLIP_NULL;
    } else if (!(noslip_is_finite(dt) && noslip_all_finite(u, self->count) &&
                 noslip_all_finite(nu, self->count))) {
        made = NOSLIP_NONFINITE;
    } else if (!(dt > 0 && dt <= 2 * self->period)) {
        made = NOSLIP_RANGE;
    } else {
        made = noslip_velocity_target(self, u, nu, dt, target);
    }
    if (made < 0) {
        noslip_write_zeros(target, self->count);
        if (noslip_velocity_limit(self, target, time) < 0) {              /* dt is too short for any change */
            noslip_write(self->command, target, self->count);
        }
    }
    for (i = 0; i < self->count; i++) {
        target[i] = noslip_clip(target[i], self->limits[i].speed);
        self->command[i] = target[i];
    }
    noslip_write(target, command, self->count);
    return made == NOSLIP_OK || (made > 0 && status > 0) ? status : made;
}

/* -- float: generated from noslip_velocity.inc by guarantees/headers.py ------------------------------------------------ */

/* Limits of one quasi-velocity, such as the rate of a wheel; all must be positive. Units: those of the quasi-velocity. */
typedef struct noslip_velocity_limits_f {
    float speed;              /* largest command, such as rad/s */
    float acceleration;       /* largest change of the command per second, such as rad/s^2 */
    float band;               /* largest difference between command and measured velocity, such as rad/s */
} noslip_velocity_limits_f;

/* Commands for velocity-controlled drives: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_velocity_f {
    noslip_velocity_limits_f limits[NOSLIP_VELOCITIES];
    float command[NOSLIP_VELOCITIES];       /* of the last step */
    float period;                           /* s */
    int count;                              /* of quasi-velocities */
    int ready;
} noslip_velocity_f;

/*
 * Initializes with commands of zero. `limits`: one struct for each of `count` quasi-velocities, at most NOSLIP_VELOCITIES;
 * `period` (s) is the usual time between two steps. Returns NOSLIP_BAD_PARAMETER for another count, or a limit, a period or a change
 * in two periods that is not finite and positive.
 */
NOSLIP_NODISCARD static inline int noslip_velocity_init_f(noslip_velocity_f *self,
                              const noslip_velocity_limits_f *limits, int count,
                              float period)
{
    int i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (limits == NULL) {
        return NOSLIP_NULL;
    }
    if (count < 1 || count > NOSLIP_VELOCITIES || !noslip_is_positive_f(period)) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_is_positive_f(limits[i].speed) && noslip_is_positive_f(limits[i].band) &&
              noslip_is_positive_f(limits[i].acceleration) &&
              noslip_is_positive_f(limits[i].acceleration * (2 * period)))) {
            return NOSLIP_BAD_PARAMETER;
        }
        self->limits[i] = limits[i];
        self->command[i] = 0;
    }
    self->period = period;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Restarts from the measured velocities `nu`, so that the drives get no jump: before the first step, and after the drives were
 * off. Commands are limited to the largest speeds. On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE.
 */
static inline int noslip_velocity_reset_f(noslip_velocity_f *self, const float *nu)
{
    int i;
    if (self == NULL || nu == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_all_finite_f(nu, self->count)) {
        return NOSLIP_NONFINITE;
    }
    for (i = 0; i < self->count; i++) {
        self->command[i] = noslip_clip_f(nu[i], self->limits[i].speed);
    }
    return NOSLIP_OK;
}

/*
 * Moves `target` towards the commands so that no acceleration exceeds its limit over dt (s): all changes are divided by the same
 * number, which keeps their proportions. Returns NOSLIP_SATURATED if that was needed, NOSLIP_NONFINITE if it is not possible.
 */
static inline int noslip_velocity_limit_f(const noslip_velocity_f *self, float *target, float dt)
{
    float most = 1;
    int i;
    for (i = 0; i < self->count; i++) {
        const float change = noslip_abs_f(target[i] - self->command[i]);
        const float step = self->limits[i].acceleration * dt;
        if (!(step > 0 && noslip_is_finite_f(change) && noslip_is_finite_f(change / step))) {
            return NOSLIP_NONFINITE;
        }
        most = change / step > most ? change / step : most;
    }
    if (!(most > 1)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < self->count; i++) {
        const float from = self->command[i], step = self->limits[i].acceleration * dt;
        target[i] = from + noslip_clip_f((target[i] - from) / most, step);
    }
    return NOSLIP_SATURATED;
}

/*
 * Computes `target` from the accelerations u and the measured velocities: the velocities that u leads to in dt, within every limit.
 * Returns as noslip_velocity_limit.
 */
static inline int noslip_velocity_target_f(const noslip_velocity_f *self, const float *u,
                          const float *nu, float dt, float *target)
{
    float most = 1;
    int i, limited, again;
    for (i = 0; i < self->count; i++) {
        target[i] = self->command[i] + u[i] * dt;
    }
    limited = noslip_velocity_limit_f(self, target, dt);
    if (limited < 0) {
        return limited;
    }
    for (i = 0; i < self->count; i++) {
        const float ratio = noslip_abs_f(target[i]) / self->limits[i].speed;
        most = ratio > most ? ratio : most;
    }
    for (i = 0; i < self->count; i++) {
        const float slowed = target[i] / most, band = self->limits[i].band;
        const float low = nu[i] - band, high = nu[i] + band;
        const float near = slowed > high ? high : slowed < low ? low : slowed;
        const float made = noslip_clip_f(near, self->limits[i].speed);
        limited = made > target[i] || made < target[i] ? NOSLIP_SATURATED : limited;
        target[i] = made;
    }
    again = noslip_velocity_limit_f(self, target, dt);
    return again == NOSLIP_OK ? limited : again;
}

/*
 * Writes `count` commands: the velocities that the accelerations u lead to in dt (s), the time to the next step, of 0 to 2 periods.
 * `nu` are the measured velocities, `status` is what the step of the law returned.
 *
 * - No command exceeds its limit `speed`, and none changes faster than its limit `acceleration`. If u would, all accelerations are
 *   divided by the same number, and so are all speeds, so that the vehicle keeps its curvature.
 * - A command farther than `band` from the measured velocity, such as that of a blocked wheel, goes back (anti-windup).
 * - On an error, in `status` or in an argument, u is not used: the commands go to zero together with the largest accelerations; over
 *   `period` if dt is not usable.
 *
 * Returns the error, `status` if it is positive, NOSLIP_SATURATED if a command was limited, else NOSLIP_OK. NOSLIP_NONFINITE: a
 * number is not finite or leads beyond finite numbers; NOSLIP_RANGE: dt; NOSLIP_NULL: u or nu. Nothing is written without `self` or
 * `command` (NOSLIP_NULL) or before init (NOSLIP_NOT_READY).
 */
static inline int noslip_velocity_step_f(noslip_velocity_f *self, const float *u,
                        const float *nu, int status, float dt, float *command)
{
    float target[NOSLIP_VELOCITIES], time;
    int i, made = NOSLIP_OK;
    if (self == NULL || command == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    noslip_write_zeros_f(target, NOSLIP_VELOCITIES);
    time = dt > 0 && dt <= 2 * self->period ? dt : self->period;
    if (status < 0) {
        made = status;
    } else if (u == NULL || nu == NULL) {
        made = NOSLIP_NULL;
    } else if (!(noslip_is_finite_f(dt) && noslip_all_finite_f(u, self->count) &&
                 noslip_all_finite_f(nu, self->count))) {
        made = NOSLIP_NONFINITE;
    } else if (!(dt > 0 && dt <= 2 * self->period)) {
        made = NOSLIP_RANGE;
    } else {
        made = noslip_velocity_target_f(self, u, nu, dt, target);
    }
    if (made < 0) {
        noslip_write_zeros_f(target, self->count);
        if (noslip_velocity_limit_f(self, target, time) < 0) {            /* dt is too short for any change */
            noslip_write_f(self->command, target, self->count);
        }
    }
    for (i = 0; i < self->count; i++) {
        target[i] = noslip_clip_f(target[i], self->limits[i].speed);
        self->command[i] = target[i];
    }
    noslip_write_f(target, command, self->count);
    return made == NOSLIP_OK || (made > 0 && status > 0) ? status : made;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
