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

/*
 * A vehicle with two quasi-velocities: forward speed (m/s) = forward[0] nu[0] + forward[1] nu[1], yaw rate (rad/s) with `turn`, as
 * in noslip_odometry_options; and the largest accelerations (m/s^2) of its motion. With along^2 + lateral^2 <= (mu g)^2 the commands
 * ask for no more than friction gives.
 */
typedef struct noslip_velocity_vehicle {
    double forward[2];
    double turn[2];
    double along;        /* m/s^2: largest change of the forward speed per second; positive */
    double lateral;      /* m/s^2: largest product of forward speed and yaw rate, v^2 x curvature; positive */
} noslip_velocity_vehicle;

/* Commands for velocity-controlled drives: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_velocity {
    noslip_velocity_limits limits[NOSLIP_VELOCITIES];
    noslip_velocity_vehicle vehicle;              /* see noslip_velocity_set_vehicle; along is 0 without it */
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
    for (i = 0; i < 2; i++) {
        self->vehicle.forward[i] = 0;
        self->vehicle.turn[i] = 0;
    }
    self->vehicle.along = 0;
    self->vehicle.lateral = 0;
    self->period = period;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Adds limits of the vehicle's motion, so that commands lead to no more than these accelerations, and noslip_velocity_twist. On an
 * error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY; NOSLIP_BAD_PARAMETER for other than two quasi-velocities, if forward speed
 * and yaw rate do not determine both, or a limit is not finite and positive.
 */
static inline int noslip_velocity_set_vehicle(noslip_velocity *self,
                                 const noslip_velocity_vehicle *vehicle)
{
    double determinant;
    int i;
    if (self == NULL || vehicle == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    determinant = vehicle->forward[0] * vehicle->turn[1] - vehicle->forward[1] * vehicle->turn[0];
    if (self->count != 2 || !noslip_is_positive(noslip_abs(determinant)) ||
        !(noslip_is_positive(vehicle->along) && noslip_is_positive(vehicle->lateral) &&
          noslip_is_positive(vehicle->along * (2 * self->period)))) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < 2; i++) {
        self->vehicle.forward[i] = vehicle->forward[i];
        self->vehicle.turn[i] = vehicle->turn[i];
    }
    self->vehicle.along = vehicle->along;
    self->vehicle.lateral = vehicle->lateral;
    return NOSLIP_OK;
}

/* Returns the combination `row` of the first two quasi-velocities. */
static inline double noslip_velocity_of(const double row[2], const double *nu)
{
    return row[0] * nu[0] + row[1] * nu[1];
}

/*
 * Writes forward speed (m/s) and yaw rate (rad/s) of the last commands, to be sent as a twist, such as cmd_vel. Zeros with
 * NOSLIP_NOT_READY before noslip_velocity_set_vehicle.
 */
static inline int noslip_velocity_twist(const noslip_velocity *self, double twist[2])
{
    int known;
    if (self == NULL || twist == NULL) {
        return NOSLIP_NULL;
    }
    known = self->ready == NOSLIP_READY && self->vehicle.along > 0;
    twist[0] = known ? noslip_velocity_of(self->vehicle.forward, self->command) : 0;
    twist[1] = known ? noslip_velocity_of(self->vehicle.turn, self->command) : 0;
    return known ? NOSLIP_OK : NOSLIP_NOT_READY;
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
 * Moves `target` towards the commands so that no acceleration exceeds its limit over dt (s), that of the vehicle along its way too:
 * all changes are divided by the same number, which keeps their proportions. Returns NOSLIP_SATURATED if that was needed,
 * NOSLIP_NONFINITE if it is not possible.
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
    if (self->vehicle.along > 0) {
        const double change[2] = {target[0] - self->command[0], target[1] - self->command[1]};
        const double along = noslip_abs(noslip_velocity_of(self->vehicle.forward, change));
        const double step = self->vehicle.along * dt;
        if (!(step > 0 && noslip_is_finite(along / step))) {
            return NOSLIP_NONFINITE;
        }
        most = along / step > most ? along / step : most;
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

/* Returns v^2 x curvature (m/s^2, not negative) of the velocities `nu` of a vehicle. */
static inline double noslip_velocity_lateral(const noslip_velocity_vehicle *vehicle,
                                const double *nu)
{
    return noslip_abs(noslip_velocity_of(vehicle->forward, nu) *
                                   noslip_velocity_of(vehicle->turn, nu));
}

/* Writes the velocities of a vehicle with this forward speed and yaw rate. */
static inline void noslip_velocity_with_twist(const noslip_velocity_vehicle *vehicle, double speed,
                            double yaw, double nu[2])
{
    const double determinant = vehicle->forward[0] * vehicle->turn[1] - vehicle->forward[1] * vehicle->turn[0];
    nu[0] = (vehicle->turn[1] * speed - vehicle->forward[1] * yaw) / determinant;
    nu[1] = (vehicle->forward[0] * yaw - vehicle->turn[0] * speed) / determinant;
}

/*
 * Changes `target` so that the forward speed changes by at most `along` x dt, with the desired curvature while it is not yet reached,
 * and the yaw rate is within the lateral limit at that speed. Returns NOSLIP_OK, NOSLIP_SATURATED or NOSLIP_GRIP_LIMITED.
 */
static inline int noslip_velocity_roll(const noslip_velocity *self, double *target, double dt)
{
    const noslip_velocity_vehicle *vehicle = &self->vehicle;
    const double before = noslip_velocity_of(vehicle->forward, self->command);
    const double speed = noslip_velocity_of(vehicle->forward, target);
    const double yaw = noslip_velocity_of(vehicle->turn, target);
    const double after = before + noslip_clip(speed - before, vehicle->along * dt);
    const int slower = noslip_abs(after) < noslip_abs(speed);
    const double turned = slower ? yaw * noslip_abs(after / speed) : yaw;
    const int beyond = noslip_abs(after * turned) > vehicle->lateral;
    if (!(slower || beyond) && noslip_abs(after) <= noslip_abs(speed)) {
        return NOSLIP_OK;
    }
    noslip_velocity_with_twist(
        vehicle, after,
        beyond ? noslip_clip(turned, vehicle->lateral / noslip_abs(after)) : turned, target);
    return beyond ? NOSLIP_GRIP_LIMITED : NOSLIP_SATURATED;
}

/*
 * Keeps `target`, to which the accelerations lead, within the lateral limit: else the vehicle slows down before it turns more, or
 * turns less before it becomes faster. If the present commands are within it, so is what is smaller in one of the two and the same in
 * the other. If they are not, the commands go to zero, and NOSLIP_WILL_SLIP is returned.
 */
static inline int noslip_velocity_hold_curve(const noslip_velocity *self, double *target,
                           double dt)
{
    const noslip_velocity_vehicle *vehicle = &self->vehicle;
    const double most = vehicle->lateral * (1 + 16 * DBL_EPSILON);
    const double before = noslip_velocity_of(vehicle->forward, self->command);
    const double after = noslip_velocity_of(vehicle->forward, target);
    const double yaw = noslip_velocity_of(vehicle->turn, self->command);
    const double turned = noslip_velocity_of(vehicle->turn, target);
    const int slower = noslip_abs(after) <= noslip_abs(before);
    const int straighter = !slower && noslip_abs(turned) <= noslip_abs(yaw);
    int status;
    if (noslip_velocity_lateral(vehicle, target) <= most) {
        return NOSLIP_OK;
    }
    noslip_velocity_with_twist(vehicle, slower ? after : before, straighter ? turned : yaw, target);
    status = noslip_velocity_limit(self, target, dt);
    if (status < 0 || noslip_velocity_lateral(vehicle, target) <= most) {
        return status < 0 ? status : NOSLIP_GRIP_LIMITED;
    }
    target[0] = 0;
    target[1] = 0;
    status = noslip_velocity_limit(self, target, dt);
    return status < 0 ? status : NOSLIP_WILL_SLIP;
}

/*
 * Changes `target`, the desired commands after dt, so that it is within every limit; `nu` are the measured velocities. Returns
 * NOSLIP_OK, NOSLIP_SATURATED, NOSLIP_GRIP_LIMITED or NOSLIP_WILL_SLIP, or as noslip_velocity_limit.
 */
static inline int noslip_velocity_within(const noslip_velocity *self, const double *nu,
                       double dt, double *target)
{
    double most = 1;
    int i, limited = NOSLIP_OK, again, curve;
    for (i = 0; i < self->count; i++) {
        const double ratio = noslip_abs(target[i]) / self->limits[i].speed;
        most = ratio > most ? ratio : most;
    }
    if (self->vehicle.along > 0) {
        const double lateral = noslip_velocity_lateral(&self->vehicle, target) / self->vehicle.lateral;
        if (lateral > most * most) {
            most = noslip_sqrt(lateral);
            limited = NOSLIP_GRIP_LIMITED;
        }
    }
    for (i = 0; i < self->count; i++) {
        const double slowed = target[i] / most, band = self->limits[i].band;
        const double low = nu[i] - band, high = nu[i] + band;
        const double reachable = slowed > high ? high : slowed < low ? low : slowed;
        const double made = noslip_clip(reachable, self->limits[i].speed);
        limited = limited == NOSLIP_OK && (made > target[i] || made < target[i]) ? NOSLIP_SATURATED : limited;
        target[i] = made;
    }
    if (self->vehicle.along > 0) {
        const int rolls = noslip_velocity_roll(self, target, dt);
        limited = rolls > limited ? rolls : limited;
    }
    again = noslip_velocity_limit(self, target, dt);
    if (again < 0) {
        return again;
    }
    limited = limited == NOSLIP_OK ? again : limited;
    curve = self->vehicle.along > 0 ? noslip_velocity_hold_curve(self, target, dt) : NOSLIP_OK;
    return curve == NOSLIP_OK ? limited : curve;
}

/* Makes and writes the commands of noslip_velocity_step and noslip_velocity_follow: `given` are accelerations, if `integrates`. */
static inline int noslip_velocity_make(noslip_velocity *self, const double *given, int integrates,
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
    } else if (given == NULL || nu == NULL) {
        made = NOSLIP_NULL;
    } else if (!(noslip_is_finite(dt) && noslip_all_finite(given, self->count) &&
                 noslip_all_finite(nu, self->count))) {
        made = NOSLIP_NONFINITE;
    } else if (!(dt > 0 && dt <= 2 * self->period)) {
        made = NOSLIP_RANGE;
    } else {
        for (i = 0; i < self->count; i++) {
            target[i] = integrates ? self->command[i] + given[i] * dt : given[i];
        }
        made = integrates ? noslip_velocity_limit(self, target, dt) : NOSLIP_OK;
        if (made >= 0) {
            const int within = noslip_velocity_within(self, nu, dt, target);
            made = within == NOSLIP_OK ? made : within;
        }
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

/*
 * Writes `count` commands: the velocities that the accelerations u lead to in dt (s), the time to the next step, of 0 to 2 periods.
 * `nu` are the measured velocities, `status` is what the step of the law returned.
 *
 * - No command exceeds its limit `speed`, and none changes faster than its limit `acceleration`. If u would, all accelerations are
 *   divided by the same number, and so are all speeds, so that the vehicle keeps its curvature.
 * - A command farther than `band` from the measured velocity, such as that of a blocked wheel, goes back (anti-windup).
 * - With noslip_velocity_set_vehicle the forward speed changes by at most `along` x dt, and speed x yaw rate stays within `lateral`:
 *   the vehicle slows down on its curve, and before it turns more, for which a command may leave its band.
 * - On an error, in `status` or in an argument, u is not used: the commands go to zero together with the largest accelerations; over
 *   `period` if dt is not usable.
 *
 * Returns the error, `status` if it is positive, NOSLIP_SATURATED if a command was limited, NOSLIP_GRIP_LIMITED if that was due to
 * `lateral`, NOSLIP_WILL_SLIP if the commands were beyond it before, and go to zero, else NOSLIP_OK. NOSLIP_NONFINITE: a
 * number is not finite or leads beyond finite numbers; NOSLIP_RANGE: dt; NOSLIP_NULL: u or nu. Nothing is written without `self` or
 * `command` (NOSLIP_NULL) or before init (NOSLIP_NOT_READY).
 */
static inline int noslip_velocity_step(noslip_velocity *self, const double *u,
                     const double *nu, int status, double dt, double *command)
{
    return noslip_velocity_make(self, u, 1, nu, status, dt, command);
}

/*
 * Writes `count` commands that follow the `desired` velocities, such as those of a kinematic law, in the same way and with the same
 * status as noslip_velocity_step: speeds beyond a limit are divided by the same number, and so are changes.
 */
static inline int noslip_velocity_follow(noslip_velocity *self, const double *desired,
                       const double *nu, int status, double dt, double *command)
{
    return noslip_velocity_make(self, desired, 0, nu, status, dt, command);
}

/* -- float: generated from noslip_velocity.inc by guarantees/headers.py ------------------------------------------------ */

/* Limits of one quasi-velocity, such as the rate of a wheel; all must be positive. Units: those of the quasi-velocity. */
typedef struct noslip_velocity_limits_f {
    float speed;              /* largest command, such as rad/s */
    float acceleration;       /* largest change of the command per second, such as rad/s^2 */
    float band;               /* largest difference between command and measured velocity, such as rad/s */
} noslip_velocity_limits_f;

/*
 * A vehicle with two quasi-velocities: forward speed (m/s) = forward[0] nu[0] + forward[1] nu[1], yaw rate (rad/s) with `turn`, as
 * in noslip_odometry_options; and the largest accelerations (m/s^2) of its motion. With along^2 + lateral^2 <= (mu g)^2 the commands
 * ask for no more than friction gives.
 */
typedef struct noslip_velocity_vehicle_f {
    float forward[2];
    float turn[2];
    float along;         /* m/s^2: largest change of the forward speed per second; positive */
    float lateral;       /* m/s^2: largest product of forward speed and yaw rate, v^2 x curvature; positive */
} noslip_velocity_vehicle_f;

/* Commands for velocity-controlled drives: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_velocity_f {
    noslip_velocity_limits_f limits[NOSLIP_VELOCITIES];
    noslip_velocity_vehicle_f vehicle;            /* see noslip_velocity_set_vehicle; along is 0 without it */
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
    for (i = 0; i < 2; i++) {
        self->vehicle.forward[i] = 0;
        self->vehicle.turn[i] = 0;
    }
    self->vehicle.along = 0;
    self->vehicle.lateral = 0;
    self->period = period;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Adds limits of the vehicle's motion, so that commands lead to no more than these accelerations, and noslip_velocity_twist. On an
 * error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY; NOSLIP_BAD_PARAMETER for other than two quasi-velocities, if forward speed
 * and yaw rate do not determine both, or a limit is not finite and positive.
 */
static inline int noslip_velocity_set_vehicle_f(noslip_velocity_f *self,
                                     const noslip_velocity_vehicle_f *vehicle)
{
    float determinant;
    int i;
    if (self == NULL || vehicle == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    determinant = vehicle->forward[0] * vehicle->turn[1] - vehicle->forward[1] * vehicle->turn[0];
    if (self->count != 2 || !noslip_is_positive_f(noslip_abs_f(determinant)) ||
        !(noslip_is_positive_f(vehicle->along) && noslip_is_positive_f(vehicle->lateral) &&
          noslip_is_positive_f(vehicle->along * (2 * self->period)))) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < 2; i++) {
        self->vehicle.forward[i] = vehicle->forward[i];
        self->vehicle.turn[i] = vehicle->turn[i];
    }
    self->vehicle.along = vehicle->along;
    self->vehicle.lateral = vehicle->lateral;
    return NOSLIP_OK;
}

/* Returns the combination `row` of the first two quasi-velocities. */
static inline float noslip_velocity_of_f(const float row[2], const float *nu)
{
    return row[0] * nu[0] + row[1] * nu[1];
}

/*
 * Writes forward speed (m/s) and yaw rate (rad/s) of the last commands, to be sent as a twist, such as cmd_vel. Zeros with
 * NOSLIP_NOT_READY before noslip_velocity_set_vehicle.
 */
static inline int noslip_velocity_twist_f(const noslip_velocity_f *self, float twist[2])
{
    int known;
    if (self == NULL || twist == NULL) {
        return NOSLIP_NULL;
    }
    known = self->ready == NOSLIP_READY && self->vehicle.along > 0;
    twist[0] = known ? noslip_velocity_of_f(self->vehicle.forward, self->command) : 0;
    twist[1] = known ? noslip_velocity_of_f(self->vehicle.turn, self->command) : 0;
    return known ? NOSLIP_OK : NOSLIP_NOT_READY;
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
 * Moves `target` towards the commands so that no acceleration exceeds its limit over dt (s), that of the vehicle along its way too:
 * all changes are divided by the same number, which keeps their proportions. Returns NOSLIP_SATURATED if that was needed,
 * NOSLIP_NONFINITE if it is not possible.
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
    if (self->vehicle.along > 0) {
        const float change[2] = {target[0] - self->command[0], target[1] - self->command[1]};
        const float along = noslip_abs_f(noslip_velocity_of_f(self->vehicle.forward, change));
        const float step = self->vehicle.along * dt;
        if (!(step > 0 && noslip_is_finite_f(along / step))) {
            return NOSLIP_NONFINITE;
        }
        most = along / step > most ? along / step : most;
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

/* Returns v^2 x curvature (m/s^2, not negative) of the velocities `nu` of a vehicle. */
static inline float noslip_velocity_lateral_f(const noslip_velocity_vehicle_f *vehicle,
                                   const float *nu)
{
    return noslip_abs_f(noslip_velocity_of_f(vehicle->forward, nu) *
                                   noslip_velocity_of_f(vehicle->turn, nu));
}

/* Writes the velocities of a vehicle with this forward speed and yaw rate. */
static inline void noslip_velocity_with_twist_f(const noslip_velocity_vehicle_f *vehicle, float speed,
                               float yaw, float nu[2])
{
    const float determinant = vehicle->forward[0] * vehicle->turn[1] - vehicle->forward[1] * vehicle->turn[0];
    nu[0] = (vehicle->turn[1] * speed - vehicle->forward[1] * yaw) / determinant;
    nu[1] = (vehicle->forward[0] * yaw - vehicle->turn[0] * speed) / determinant;
}

/*
 * Changes `target` so that the forward speed changes by at most `along` x dt, with the desired curvature while it is not yet reached,
 * and the yaw rate is within the lateral limit at that speed. Returns NOSLIP_OK, NOSLIP_SATURATED or NOSLIP_GRIP_LIMITED.
 */
static inline int noslip_velocity_roll_f(const noslip_velocity_f *self, float *target, float dt)
{
    const noslip_velocity_vehicle_f *vehicle = &self->vehicle;
    const float before = noslip_velocity_of_f(vehicle->forward, self->command);
    const float speed = noslip_velocity_of_f(vehicle->forward, target);
    const float yaw = noslip_velocity_of_f(vehicle->turn, target);
    const float after = before + noslip_clip_f(speed - before, vehicle->along * dt);
    const int slower = noslip_abs_f(after) < noslip_abs_f(speed);
    const float turned = slower ? yaw * noslip_abs_f(after / speed) : yaw;
    const int beyond = noslip_abs_f(after * turned) > vehicle->lateral;
    if (!(slower || beyond) && noslip_abs_f(after) <= noslip_abs_f(speed)) {
        return NOSLIP_OK;
    }
    noslip_velocity_with_twist_f(
        vehicle, after,
        beyond ? noslip_clip_f(turned, vehicle->lateral / noslip_abs_f(after)) : turned, target);
    return beyond ? NOSLIP_GRIP_LIMITED : NOSLIP_SATURATED;
}

/*
 * Keeps `target`, to which the accelerations lead, within the lateral limit: else the vehicle slows down before it turns more, or
 * turns less before it becomes faster. If the present commands are within it, so is what is smaller in one of the two and the same in
 * the other. If they are not, the commands go to zero, and NOSLIP_WILL_SLIP is returned.
 */
static inline int noslip_velocity_hold_curve_f(const noslip_velocity_f *self, float *target,
                              float dt)
{
    const noslip_velocity_vehicle_f *vehicle = &self->vehicle;
    const float most = vehicle->lateral * (1 + 16 * FLT_EPSILON);
    const float before = noslip_velocity_of_f(vehicle->forward, self->command);
    const float after = noslip_velocity_of_f(vehicle->forward, target);
    const float yaw = noslip_velocity_of_f(vehicle->turn, self->command);
    const float turned = noslip_velocity_of_f(vehicle->turn, target);
    const int slower = noslip_abs_f(after) <= noslip_abs_f(before);
    const int straighter = !slower && noslip_abs_f(turned) <= noslip_abs_f(yaw);
    int status;
    if (noslip_velocity_lateral_f(vehicle, target) <= most) {
        return NOSLIP_OK;
    }
    noslip_velocity_with_twist_f(vehicle, slower ? after : before, straighter ? turned : yaw, target);
    status = noslip_velocity_limit_f(self, target, dt);
    if (status < 0 || noslip_velocity_lateral_f(vehicle, target) <= most) {
        return status < 0 ? status : NOSLIP_GRIP_LIMITED;
    }
    target[0] = 0;
    target[1] = 0;
    status = noslip_velocity_limit_f(self, target, dt);
    return status < 0 ? status : NOSLIP_WILL_SLIP;
}

/*
 * Changes `target`, the desired commands after dt, so that it is within every limit; `nu` are the measured velocities. Returns
 * NOSLIP_OK, NOSLIP_SATURATED, NOSLIP_GRIP_LIMITED or NOSLIP_WILL_SLIP, or as noslip_velocity_limit.
 */
static inline int noslip_velocity_within_f(const noslip_velocity_f *self, const float *nu,
                          float dt, float *target)
{
    float most = 1;
    int i, limited = NOSLIP_OK, again, curve;
    for (i = 0; i < self->count; i++) {
        const float ratio = noslip_abs_f(target[i]) / self->limits[i].speed;
        most = ratio > most ? ratio : most;
    }
    if (self->vehicle.along > 0) {
        const float lateral = noslip_velocity_lateral_f(&self->vehicle, target) / self->vehicle.lateral;
        if (lateral > most * most) {
            most = noslip_sqrt_f(lateral);
            limited = NOSLIP_GRIP_LIMITED;
        }
    }
    for (i = 0; i < self->count; i++) {
        const float slowed = target[i] / most, band = self->limits[i].band;
        const float low = nu[i] - band, high = nu[i] + band;
        const float reachable = slowed > high ? high : slowed < low ? low : slowed;
        const float made = noslip_clip_f(reachable, self->limits[i].speed);
        limited = limited == NOSLIP_OK && (made > target[i] || made < target[i]) ? NOSLIP_SATURATED : limited;
        target[i] = made;
    }
    if (self->vehicle.along > 0) {
        const int rolls = noslip_velocity_roll_f(self, target, dt);
        limited = rolls > limited ? rolls : limited;
    }
    again = noslip_velocity_limit_f(self, target, dt);
    if (again < 0) {
        return again;
    }
    limited = limited == NOSLIP_OK ? again : limited;
    curve = self->vehicle.along > 0 ? noslip_velocity_hold_curve_f(self, target, dt) : NOSLIP_OK;
    return curve == NOSLIP_OK ? limited : curve;
}

/* Makes and writes the commands of noslip_velocity_step and noslip_velocity_follow: `given` are accelerations, if `integrates`. */
static inline int noslip_velocity_make_f(noslip_velocity_f *self, const float *given, int integrates,
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
    } else if (given == NULL || nu == NULL) {
        made = NOSLIP_NULL;
    } else if (!(noslip_is_finite_f(dt) && noslip_all_finite_f(given, self->count) &&
                 noslip_all_finite_f(nu, self->count))) {
        made = NOSLIP_NONFINITE;
    } else if (!(dt > 0 && dt <= 2 * self->period)) {
        made = NOSLIP_RANGE;
    } else {
        for (i = 0; i < self->count; i++) {
            target[i] = integrates ? self->command[i] + given[i] * dt : given[i];
        }
        made = integrates ? noslip_velocity_limit_f(self, target, dt) : NOSLIP_OK;
        if (made >= 0) {
            const int within = noslip_velocity_within_f(self, nu, dt, target);
            made = within == NOSLIP_OK ? made : within;
        }
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

/*
 * Writes `count` commands: the velocities that the accelerations u lead to in dt (s), the time to the next step, of 0 to 2 periods.
 * `nu` are the measured velocities, `status` is what the step of the law returned.
 *
 * - No command exceeds its limit `speed`, and none changes faster than its limit `acceleration`. If u would, all accelerations are
 *   divided by the same number, and so are all speeds, so that the vehicle keeps its curvature.
 * - A command farther than `band` from the measured velocity, such as that of a blocked wheel, goes back (anti-windup).
 * - With noslip_velocity_set_vehicle the forward speed changes by at most `along` x dt, and speed x yaw rate stays within `lateral`:
 *   the vehicle slows down on its curve, and before it turns more, for which a command may leave its band.
 * - On an error, in `status` or in an argument, u is not used: the commands go to zero together with the largest accelerations; over
 *   `period` if dt is not usable.
 *
 * Returns the error, `status` if it is positive, NOSLIP_SATURATED if a command was limited, NOSLIP_GRIP_LIMITED if that was due to
 * `lateral`, NOSLIP_WILL_SLIP if the commands were beyond it before, and go to zero, else NOSLIP_OK. NOSLIP_NONFINITE: a
 * number is not finite or leads beyond finite numbers; NOSLIP_RANGE: dt; NOSLIP_NULL: u or nu. Nothing is written without `self` or
 * `command` (NOSLIP_NULL) or before init (NOSLIP_NOT_READY).
 */
static inline int noslip_velocity_step_f(noslip_velocity_f *self, const float *u,
                        const float *nu, int status, float dt, float *command)
{
    return noslip_velocity_make_f(self, u, 1, nu, status, dt, command);
}

/*
 * Writes `count` commands that follow the `desired` velocities, such as those of a kinematic law, in the same way and with the same
 * status as noslip_velocity_step: speeds beyond a limit are divided by the same number, and so are changes.
 */
static inline int noslip_velocity_follow_f(noslip_velocity_f *self, const float *desired,
                          const float *nu, int status, float dt, float *command)
{
    return noslip_velocity_make_f(self, desired, 0, nu, status, dt, command);
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
