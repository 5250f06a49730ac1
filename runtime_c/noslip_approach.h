/*
 * noslip_approach.h - a reference that leads the vehicle to its path with bounded acceleration.
 *
 * Without it a law of path following wants the distance to be 0 at once, and asks for more than wheels can hold when it starts
 * beside the path. The generator leads the desired distance from where the vehicle is to 0: as fast as the acceleration permits, the
 * last part linear so that it does not chatter (Han's discrete time-optimal law with a linear zone, IEEE Trans. Industrial
 * Electronics 56(3), 2009); and the desired speed from the present speed. At the start, and after each correction of the pose:
 *
 *     noslip_approach_init(&approach, 0.5, 0.25, 0);
 *     noslip_approach_start(&approach, y[0], ydot[0], y[1]);      from the law's functions output and rate
 *
 * At each call of the controller, dt after the last:
 *
 *     noslip_approach_step(&approach, dt, 1.4, &wanted);
 *     reference.distance = wanted.distance;                       and the other fields, which have the same names
 *
 * On a composite path (noslip_path.h) the final speed is guide.speed, the reference of the law after
 *
 *     noslip_approach_within(&approach, guide.speed, guide.speed_rate, &wanted);
 *
 * and noslip_approach_start is called again where guide.L changes. For a point in the plane, or a heading, one generator leads each
 * output y: start with y - y_d and its rate, and add distance, its rate and acceleration to y_d and its derivatives. Of a point,
 * each coordinate may have the acceleration divided by sqrt(2).
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_APPROACH_H
#define NOSLIP_APPROACH_H

#include "noslip_controller.h"

/* -- double: generated from noslip_approach.inc by guarantees/headers.py ----------------------------------------------- */

/* Desired distance and speed with their derivatives, as in the reference of a law of path following. */
typedef struct noslip_approached {
    double distance, distance_rate, distance_acceleration;      /* m, m/s, m/s^2 */
    double speed, speed_rate;                                   /* m/s, m/s^2 */
} noslip_approached;

/* A reference generator: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_approach {
    double acceleration;                  /* m/s^2: largest */
    double settling;                      /* s: time constant of the end */
    noslip_approached desired;              /* of the last step */
    int ready;
} noslip_approach;

/* Copies member by member: a compiler may call memcpy for a whole struct. */
static inline void noslip_approach_copy(const noslip_approached *from, noslip_approached *to)
{
    to->distance = from->distance;
    to->distance_rate = from->distance_rate;
    to->distance_acceleration = from->distance_acceleration;
    to->speed = from->speed;
    to->speed_rate = from->speed_rate;
}

/*
 * Initializes with the largest acceleration of distance and of speed (m/s^2), and the time constant `settling` (s) with which the
 * distance ends. `jerk` is reserved: it must be 0. Returns NOSLIP_BAD_PARAMETER unless the first two are finite and positive.
 */
NOSLIP_NODISCARD static inline int noslip_approach_init(noslip_approach *self, double acceleration,
                     double settling, double jerk)
{
    static const noslip_approached zero = {0, 0, 0, 0, 0};
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_positive(acceleration) && noslip_is_positive(settling) &&
        noslip_is_positive(acceleration * settling * settling)) || !(jerk <= 0 && jerk >= 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->acceleration = acceleration;
    self->settling = settling;
    noslip_approach_copy(&zero, &self->desired);
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Begins where the vehicle is: with its distance from the path (m), the rate of that (m/s) and its speed (m/s). To be called before
 * the first step, and again after the pose was corrected or the path changed. Returns NOSLIP_NONFINITE if one is not finite.
 */
static inline int noslip_approach_start(noslip_approach *self, double distance,
                      double distance_rate, double speed)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite(distance) && noslip_is_finite(distance_rate) &&
        noslip_is_finite(speed))) {
        return NOSLIP_NONFINITE;
    }
    self->desired.distance = distance;
    self->desired.distance_rate = distance_rate;
    self->desired.distance_acceleration = 0;
    self->desired.speed = speed;
    self->desired.speed_rate = 0;
    return NOSLIP_OK;
}

/* Returns the acceleration from a distance and its rate to 0, time-optimal up to a zone of size acceleration settling^2 where it is
 * linear and critically damped. */
static inline double noslip_approach_acceleration(const noslip_approach *self,
                                     double distance, double rate)
{
    const double zone = self->acceleration * self->settling * self->settling;
    const double ahead = self->settling * rate, place = distance + ahead;
    double curve = ahead + place;      /* in the zone; beyond it, how far the rate is above that of the braking curve */
    if (!(noslip_abs(place) <= zone)) {
        const double root = noslip_sqrt(zone * (zone + 8 * noslip_abs(place)));
        curve = place > 0 ? ahead + (root - zone) / 2 : ahead - (root - zone) / 2;
    }
    return curve > zone ? -self->acceleration : curve < -zone ? self->acceleration : -self->acceleration * (curve / zone);
}

/*
 * Advances by dt (s), the time since the previous call (0 at the first after a start), and computes what is desired until the next:
 * `speed` (m/s) is the final one. dt must be at most settling. Returns NOSLIP_NONFINITE or NOSLIP_RANGE if an argument is not
 * finite or out of range; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_step(noslip_approach *self, double dt, double speed,
                noslip_approached *desired)
{
    static const noslip_approached zero = {0, 0, 0, 0, 0};
    noslip_approached next;
    double missing;
    int status = NOSLIP_OK;
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        noslip_approach_copy(&zero, desired);
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    noslip_approach_copy(&self->desired, &next);
    if (!(noslip_is_finite(dt) && noslip_is_finite(speed))) {
        status = NOSLIP_NONFINITE;
    } else if (!(dt >= 0 && dt <= self->settling)) {
        status = NOSLIP_RANGE;
    } else {
        next.distance += dt * (next.distance_rate + dt * next.distance_acceleration / 2);
        next.distance_rate += dt * next.distance_acceleration;
        next.distance_acceleration = noslip_approach_acceleration(self, next.distance, next.distance_rate);
        next.speed += dt * next.speed_rate;
        missing = (speed - next.speed) / self->settling; /* linear at the end too */
        next.speed_rate = missing > self->acceleration    ? self->acceleration
                          : missing < -self->acceleration ? -self->acceleration
                                                          : missing;
        if (!(noslip_is_finite(next.distance + next.distance_rate) &&
              noslip_is_finite(next.distance_acceleration + next.speed + next.speed_rate))) {
            status = NOSLIP_NONFINITE;
        }
    }
    if (status == NOSLIP_OK) {
        noslip_approach_copy(&next, &self->desired);
    }
    noslip_approach_copy(status == NOSLIP_OK ? &next : &zero, desired);
    return status;
}

/*
 * Keeps the desired speed of the last step from 0 to `speed` (m/s), which a path allows now and changes by `speed_rate` (m/s^2);
 * a speed on the other side of 0 stays. To be called after a step where a path ends or has cusps: it brakes later, but in time.
 * Returns NOSLIP_NONFINITE if an argument is not finite; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_within(noslip_approach *self, double speed,
                       double speed_rate, noslip_approached *desired)
{
    static const noslip_approached zero = {0, 0, 0, 0, 0};
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    noslip_approach_copy(&zero, desired);
    if (self == NULL || self->ready != NOSLIP_READY) {
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite(speed) && noslip_is_finite(speed_rate))) {
        return NOSLIP_NONFINITE;
    }
    if ((speed >= 0 && self->desired.speed > speed) || (speed <= 0 && self->desired.speed < speed)) {
        self->desired.speed = speed;
        self->desired.speed_rate = speed_rate;
    }
    noslip_approach_copy(&self->desired, desired);
    return NOSLIP_OK;
}

/* -- float: generated from noslip_approach.inc by guarantees/headers.py ------------------------------------------------ */

/* Desired distance and speed with their derivatives, as in the reference of a law of path following. */
typedef struct noslip_approached_f {
    float distance, distance_rate, distance_acceleration;       /* m, m/s, m/s^2 */
    float speed, speed_rate;                                    /* m/s, m/s^2 */
} noslip_approached_f;

/* A reference generator: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_approach_f {
    float acceleration;                   /* m/s^2: largest */
    float settling;                       /* s: time constant of the end */
    noslip_approached_f desired;            /* of the last step */
    int ready;
} noslip_approach_f;

/* Copies member by member: a compiler may call memcpy for a whole struct. */
static inline void noslip_approach_copy_f(const noslip_approached_f *from, noslip_approached_f *to)
{
    to->distance = from->distance;
    to->distance_rate = from->distance_rate;
    to->distance_acceleration = from->distance_acceleration;
    to->speed = from->speed;
    to->speed_rate = from->speed_rate;
}

/*
 * Initializes with the largest acceleration of distance and of speed (m/s^2), and the time constant `settling` (s) with which the
 * distance ends. `jerk` is reserved: it must be 0. Returns NOSLIP_BAD_PARAMETER unless the first two are finite and positive.
 */
NOSLIP_NODISCARD static inline int noslip_approach_init_f(noslip_approach_f *self, float acceleration,
                        float settling, float jerk)
{
    static const noslip_approached_f zero = {0, 0, 0, 0, 0};
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_positive_f(acceleration) && noslip_is_positive_f(settling) &&
        noslip_is_positive_f(acceleration * settling * settling)) || !(jerk <= 0 && jerk >= 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->acceleration = acceleration;
    self->settling = settling;
    noslip_approach_copy_f(&zero, &self->desired);
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Begins where the vehicle is: with its distance from the path (m), the rate of that (m/s) and its speed (m/s). To be called before
 * the first step, and again after the pose was corrected or the path changed. Returns NOSLIP_NONFINITE if one is not finite.
 */
static inline int noslip_approach_start_f(noslip_approach_f *self, float distance,
                         float distance_rate, float speed)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite_f(distance) && noslip_is_finite_f(distance_rate) &&
        noslip_is_finite_f(speed))) {
        return NOSLIP_NONFINITE;
    }
    self->desired.distance = distance;
    self->desired.distance_rate = distance_rate;
    self->desired.distance_acceleration = 0;
    self->desired.speed = speed;
    self->desired.speed_rate = 0;
    return NOSLIP_OK;
}

/* Returns the acceleration from a distance and its rate to 0, time-optimal up to a zone of size acceleration settling^2 where it is
 * linear and critically damped. */
static inline float noslip_approach_acceleration_f(const noslip_approach_f *self,
                                        float distance, float rate)
{
    const float zone = self->acceleration * self->settling * self->settling;
    const float ahead = self->settling * rate, place = distance + ahead;
    float curve = ahead + place;       /* in the zone; beyond it, how far the rate is above that of the braking curve */
    if (!(noslip_abs_f(place) <= zone)) {
        const float root = noslip_sqrt_f(zone * (zone + 8 * noslip_abs_f(place)));
        curve = place > 0 ? ahead + (root - zone) / 2 : ahead - (root - zone) / 2;
    }
    return curve > zone ? -self->acceleration : curve < -zone ? self->acceleration : -self->acceleration * (curve / zone);
}

/*
 * Advances by dt (s), the time since the previous call (0 at the first after a start), and computes what is desired until the next:
 * `speed` (m/s) is the final one. dt must be at most settling. Returns NOSLIP_NONFINITE or NOSLIP_RANGE if an argument is not
 * finite or out of range; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_step_f(noslip_approach_f *self, float dt, float speed,
                  noslip_approached_f *desired)
{
    static const noslip_approached_f zero = {0, 0, 0, 0, 0};
    noslip_approached_f next;
    float missing;
    int status = NOSLIP_OK;
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        noslip_approach_copy_f(&zero, desired);
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    noslip_approach_copy_f(&self->desired, &next);
    if (!(noslip_is_finite_f(dt) && noslip_is_finite_f(speed))) {
        status = NOSLIP_NONFINITE;
    } else if (!(dt >= 0 && dt <= self->settling)) {
        status = NOSLIP_RANGE;
    } else {
        next.distance += dt * (next.distance_rate + dt * next.distance_acceleration / 2);
        next.distance_rate += dt * next.distance_acceleration;
        next.distance_acceleration = noslip_approach_acceleration_f(self, next.distance, next.distance_rate);
        next.speed += dt * next.speed_rate;
        missing = (speed - next.speed) / self->settling; /* linear at the end too */
        next.speed_rate = missing > self->acceleration    ? self->acceleration
                          : missing < -self->acceleration ? -self->acceleration
                                                          : missing;
        if (!(noslip_is_finite_f(next.distance + next.distance_rate) &&
              noslip_is_finite_f(next.distance_acceleration + next.speed + next.speed_rate))) {
            status = NOSLIP_NONFINITE;
        }
    }
    if (status == NOSLIP_OK) {
        noslip_approach_copy_f(&next, &self->desired);
    }
    noslip_approach_copy_f(status == NOSLIP_OK ? &next : &zero, desired);
    return status;
}

/*
 * Keeps the desired speed of the last step from 0 to `speed` (m/s), which a path allows now and changes by `speed_rate` (m/s^2);
 * a speed on the other side of 0 stays. To be called after a step where a path ends or has cusps: it brakes later, but in time.
 * Returns NOSLIP_NONFINITE if an argument is not finite; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_within_f(noslip_approach_f *self, float speed,
                          float speed_rate, noslip_approached_f *desired)
{
    static const noslip_approached_f zero = {0, 0, 0, 0, 0};
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    noslip_approach_copy_f(&zero, desired);
    if (self == NULL || self->ready != NOSLIP_READY) {
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite_f(speed) && noslip_is_finite_f(speed_rate))) {
        return NOSLIP_NONFINITE;
    }
    if ((speed >= 0 && self->desired.speed > speed) || (speed <= 0 && self->desired.speed < speed)) {
        self->desired.speed = speed;
        self->desired.speed_rate = speed_rate;
    }
    noslip_approach_copy_f(&self->desired, desired);
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
